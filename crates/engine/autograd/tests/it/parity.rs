//! Ops in `f32` against numbers computed in `f64` by PyTorch; see tests/fixtures/README.md.

use weaver_autograd::ops::{self, Activation, RopeTable};
use weaver_autograd::{Tape, Var};
use weaver_fixtures::Fixture;

/// Runs `f` on the inputs called `names` and compares its result and all gradients.
fn check<F>(file: &Fixture, op: &str, names: &[&str], f: F)
where
    F: for<'t> Fn(&[Var<'t, f32>]) -> Var<'t, f32>,
{
    let tape = Tape::<f32>::new();
    let inputs: Vec<_> = names.iter().map(|name| file.leaf(&tape, &format!("{op}.in.{name}"))).collect();
    let y = f(&inputs);
    assert_eq!(y.shape().dims(), file.shape(&format!("{op}.out")), "{op}: shape");
    file.assert_close(&format!("{op}.out"), &y.value());
    y.backward_with(&file.f32(&format!("{op}.cot")));
    for (x, name) in inputs.iter().zip(names) {
        file.assert_close(&format!("{op}.grad.{name}"), &x.grad().expect("a gradient"));
    }
}

#[test]
fn elementwise() {
    let fixture = Fixture::open("ops.safetensors");
    check(&fixture, "gelu_erf", &["input"], |x| x[0].gelu());
    check(&fixture, "relu", &["input"], |x| x[0].relu());
    check(&fixture, "silu", &["input"], |x| x[0].silu());
    check(&fixture, "softplus", &["input"], |x| x[0].softplus());
    check(&fixture, "sigmoid", &["input"], |x| x[0].sigmoid());
    check(&fixture, "tanh", &["input"], |x| x[0].tanh());
    check(&fixture, "huber", &["x", "y"], |x| ops::huber(x[0], x[1], 1.0));
}

#[test]
fn normalizations() {
    let fixture = Fixture::open("ops.safetensors");
    check(&fixture, "layer_norm_1e5", &["x", "w", "b"], |x| x[0].layer_norm(Some((x[1], x[2])), 1e-5));
    check(&fixture, "layer_norm_1e6", &["x", "w", "b"], |x| x[0].layer_norm(Some((x[1], x[2])), 1e-6));
    check(&fixture, "layer_norm_noaffine", &["x"], |x| x[0].layer_norm(None, 1e-6));
    check(&fixture, "softmax_last", &["x"], |x| x[0].softmax(2));
    check(&fixture, "softmax_dim1", &["x"], |x| x[0].softmax(1));
    let labels = fixture.indices("cross_entropy.target");
    check(&fixture, "cross_entropy", &["x"], |x| ops::cross_entropy(x[0], &labels, 0.1));
}

#[test]
fn layers() {
    let fixture = Fixture::open("ops.safetensors");
    check(&fixture, "linear", &["x", "w", "b"], |x| ops::linear(x[0], x[1], Some(x[2]), Activation::None));
    let heads_first = |x: &[Var<'_, f32>]| x[0].shape()[3] as f64;
    for op in ["sdpa", "sdpa_cross"] {
        check(&fixture, op, &["q", "k", "v"], |x| {
            let [q, k, v] = [x[0], x[1], x[2]].map(|x| x.permute(&[0, 2, 1, 3]));
            ops::attention(q, k, v, 1.0 / heads_first(x).sqrt()).permute(&[0, 2, 1, 3])
        });
    }
    // Both batch entries have the same positions.
    let positions = fixture.indices("rope2d.positions");
    let (first, second) = positions.split_at(positions.len() / 2);
    assert_eq!(first, second);
    let positions: Vec<_> = first.as_chunks::<2>().0.iter().map(|p| p.map(|p| p as usize)).collect();
    let table = RopeTable::new(&positions, 16, 100.0);
    check(&fixture, "rope2d", &["x"], |x| x[0].permute(&[0, 2, 1, 3]).rope2d(&table).permute(&[0, 2, 1, 3]));
}

#[test]
fn convolutions() {
    let fixture = Fixture::open("ops.safetensors");
    for (op, stride, padding) in [
        ("conv2d_k3s1p1", 1, 1),
        ("conv2d_k3s2p1_even", 2, 1),
        ("conv2d_k3s2p1_odd", 2, 1),
        ("conv2d_k14s14", 14, 0),
        ("conv2d_k1", 1, 0),
        ("conv2d_k7p3", 1, 3),
        ("conv2d_k5p2", 1, 2),
    ] {
        check(&fixture, op, &["x", "w", "b"], |x| ops::conv2d(x[0], x[1], Some(x[2]), stride, padding));
    }
    check(&fixture, "conv2d_nobias", &["x", "w"], |x| ops::conv2d(x[0], x[1], None, 1, 1));
    check(&fixture, "conv_transpose2d_k4", &["x", "w", "b"], |x| ops::conv_transpose2d(x[0], x[1], Some(x[2]), 4));
    check(&fixture, "conv_transpose2d_k2", &["x", "w", "b"], |x| ops::conv_transpose2d(x[0], x[1], Some(x[2]), 2));
    check(&fixture, "residual_conv_unit", &["x", "w1", "b1", "w2", "b2"], |x| {
        let positive = x[0].relu();
        let hidden = ops::conv2d(positive, x[1], Some(x[2]), 1, 1).relu();
        ops::conv2d(hidden, x[3], Some(x[4]), 1, 1) + positive
    });
}

#[test]
fn resizes() {
    let fixture = Fixture::open("ops.safetensors");
    for op in ["bicubic_aa_down", "bicubic_aa_up", "bicubic_aa_mixed", "bicubic_aa_up_far"] {
        let to = fixture.shape(&format!("{op}.out")).to_vec();
        check(&fixture, op, &["x"], |x| x[0].bicubic_antialias(to[2], to[3]));
    }
    check(&fixture, "bicubic_plain", &["x"], |x| x[0].bicubic(4, 5));
    for (align, name) in [(true, "true"), (false, "false")] {
        for case in ["up", "down", "x14_8", "one"] {
            let op = format!("bilinear_ac_{name}_{case}");
            let to = fixture.shape(&format!("{op}.out")).to_vec();
            check(&fixture, &op, &["x"], |x| x[0].bilinear(to[2], to[3], align));
        }
    }
    check(&fixture, "bilinear_ac_true_scale2", &["x"], |x| {
        x[0].bilinear(2 * x[0].shape()[2], 2 * x[0].shape()[3], true)
    });
}

/// The hard choice with the gradient of the soft one.
#[test]
fn gumbel_softmax() {
    let fixture = Fixture::open("ops.safetensors");
    let (noise, shape) = fixture.tensor("gumbel_softmax.noise");
    check(&fixture, "gumbel_softmax", &["x"], |x| {
        let tape = x[0].tape();
        let soft = ((x[0] + tape.constant(&noise, &shape[..])) * 2.0).softmax(1);
        let chosen =
            |row: &[f32]| row.iter().map(|p| f32::from(*p >= row.iter().copied().fold(0.0, f32::max))).collect();
        let hard: Vec<f32> = soft.to_vec().chunks(shape[1]).flat_map(|row| -> Vec<f32> { chosen(row) }).collect();
        ops::straight_through(soft, tape.constant(&hard, &shape[..]))
    });
}
