use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, adjoint_check, gradcheck};
use weaver_autograd::ops::RopeTable;
use weaver_autograd::{Params, Tape};
use weaver_fixtures::Fixture;
use weaver_nn::{Builder, Context};
use weaver_vggt::{IMAGENET_MEAN, IMAGENET_STD, ResidualConvUnit, add_position, normalize_image};

#[test]
fn position_parity() {
    let file = Fixture::open("ops.safetensors");
    let tape = Tape::new();
    let x = file.leaf(&tape, "dpt_pos_embed.in.x");
    let y = add_position(x, 56, 84);
    file.assert_close("dpt_pos_embed.out", &y.value());
    y.backward_with(&file.f32("dpt_pos_embed.cot"));
    file.assert_close("dpt_pos_embed.grad.x", &x.grad().unwrap());
}

/// The formula, one element at a time.
fn position(channel: usize, channels: usize, [row, column]: [usize; 2], [h, w]: [usize; 2], image: [usize; 2]) -> f64 {
    let quarter = channels / 4;
    let omega = 100_f64.powf(-((channel % quarter) as f64) / quarter as f64);
    let ratio = image[1] as f64 / image[0] as f64;
    let coordinate = |i: usize, n: usize, span: f64| {
        let end = span * (n as f64 - 1.0) / n as f64;
        if n == 1 { 0.0 } else { -end + 2.0 * end * i as f64 / (n as f64 - 1.0) }
    };
    let x = coordinate(column, w, ratio / (ratio * ratio + 1.0).sqrt());
    let y = coordinate(row, h, 1.0 / (ratio * ratio + 1.0).sqrt());
    0.1 * match channel / quarter {
        0 => (x * omega).sin(),
        1 => (x * omega).cos(),
        2 => (y * omega).sin(),
        _ => (y * omega).cos(),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 20))]

    #[test]
    fn position_signal(n in 0usize..3, quarter in 1usize..4, h in 1usize..5, w in 1usize..5, height in 1usize..9) {
        let (c, image) = (4 * quarter, [8 * height, 24]);
        let x = Input::normal(1, [n, c, h, w]);
        gradcheck(std::slice::from_ref(&x), |x| vec![add_position(x[0], image[0], image[1])]);
        let tape = Tape::<f64>::new();
        let y = add_position(tape.constant(&x.data, x.shape), image[0], image[1]).to_vec();
        for (i, (y, x)) in y.iter().zip(&x.data).enumerate() {
            let expected = position(i / (h * w) % c, c, [i / w % h, i % w], [h, w], image);
            prop_assert!((y - x - expected).abs() < 1e-14);
        }
    }

    #[test]
    fn normalization(n in 0usize..3, h in 0usize..4, w in 1usize..4) {
        let x = Input::uniform(1, 0.0, 1.0, [n, 3, h, w]);
        gradcheck(std::slice::from_ref(&x), |x| vec![normalize_image(x[0])]);
        let tape = Tape::<f64>::new();
        let y = normalize_image(tape.constant(&x.data, x.shape)).to_vec();
        for (i, (y, x)) in y.iter().zip(&x.data).enumerate() {
            let c = i / (h * w) % 3;
            prop_assert!((y - (x - f64::from(IMAGENET_MEAN[c])) / f64::from(IMAGENET_STD[c])).abs() < 1e-13);
        }
    }
}

#[test]
fn residual_unit_parity() {
    let file = Fixture::open("ops.safetensors");
    let mut params = Params::<f32>::new();
    let unit = ResidualConvUnit::new(Builder::new(&mut params, 0), 3);
    let names = [("conv1.weight", "w1"), ("conv1.bias", "b1"), ("conv2.weight", "w2"), ("conv2.bias", "b2")];
    for (name, key) in names {
        let id = params.find(name).unwrap();
        params.value_mut(id).copy_from_slice(&file.f32(&format!("residual_conv_unit.in.{key}")));
    }
    let tape = Tape::new();
    let x = file.leaf(&tape, "residual_conv_unit.in.x");
    let y = unit.forward(Context::new(&tape, &params), x);
    file.assert_close("residual_conv_unit.out", &y.value());
    y.backward_with(&file.f32("residual_conv_unit.cot"));
    file.assert_close("residual_conv_unit.grad.x", &x.grad().unwrap());
    for (name, key) in names {
        let gradient = tape.param_grad(params.find(name).unwrap()).unwrap();
        file.assert_close(&format!("residual_conv_unit.grad.{key}"), &gradient);
    }
}

/// Where the input is negative the skip path adds 0, not the input.
#[test]
fn residual_unit_rectifies_its_skip_path() {
    let mut params = Params::<f64>::new();
    let unit = ResidualConvUnit::new(Builder::new(&mut params, 0), 2);
    let run = |params: &Params<f64>, x: &[f64]| {
        let tape = Tape::new();
        unit.forward(Context::new(&tape, params), tape.constant(x, [1, 2, 1, 2])).to_vec()
    };
    assert_eq!(run(&params, &[-1.0, -2.0, -0.5, -9.0]), run(&params, &[0.0; 4]));
    for name in ["conv2.weight", "conv2.bias"] {
        let id = params.find(name).unwrap();
        params.value_mut(id).fill(0.0);
    }
    assert_eq!(run(&params, &[-1.0, 2.0, 0.5, -9.0]), [0.0, 2.0, 0.5, 0.0]);
}

/// Tokens at position (0, 0), as all special tokens are, come out as they went in; patches do not.
#[test]
fn rotary_embedding_leaves_special_tokens_alone() {
    let table = RopeTable::<f64>::new(&[[0, 0], [0, 0], [1, 1], [2, 1]], 8, 100.0);
    let x = Input::normal(1, [2, 4, 3, 8]);
    let tape = Tape::new();
    let y = tape.constant(&x.data, x.shape).rope2d(&table).to_vec();
    for (i, (y, x)) in y.chunks(3 * 8).zip(x.data.chunks(3 * 8)).enumerate() {
        assert_eq!(y == x, i % 4 < 2, "token {i}");
    }
    adjoint_check([2, 4, 3, 8], 1, |x| x.rope2d(&table));
}
