//! Layers: names, gradients, and the transformer block against its parts.

use proptest::prelude::*;
use weaver_autograd::gradcheck::Input;
use weaver_autograd::ops::{self, RopeTable};
use weaver_autograd::{Params, Tape, Var};
use weaver_nn::{
    Attention, Block, BlockConfig, Builder, Context, Conv2d, ConvTranspose2d, LayerNorm, Linear, Mlp, WeightInit,
};

const CONFIG: BlockConfig = BlockConfig {
    width: 8,
    heads: 2,
    hidden: 12,
    eps: 1e-5,
    layer_scale: Some(0.3),
    qk_norm: true,
    init: WeightInit::TruncatedNormal(0.5),
};

fn names(params: &Params<f64>) -> Vec<String> {
    params.iter().map(|(_, p)| format!("{} {}", p.name(), p.shape())).collect()
}

#[test]
fn parameters_have_the_official_names() {
    let mut params = Params::new();
    Block::new(Builder::new(&mut params, 0).scope("frame_blocks").scope(0), &CONFIG);
    let mut found = names(&params);
    found.sort();
    let mut expected: Vec<String> = [
        "norm1.weight [8]",
        "norm1.bias [8]",
        "attn.qkv.weight [24, 8]",
        "attn.qkv.bias [24]",
        "attn.q_norm.weight [4]",
        "attn.q_norm.bias [4]",
        "attn.k_norm.weight [4]",
        "attn.k_norm.bias [4]",
        "attn.proj.weight [8, 8]",
        "attn.proj.bias [8]",
        "ls1.gamma [8]",
        "norm2.weight [8]",
        "norm2.bias [8]",
        "mlp.fc1.weight [12, 8]",
        "mlp.fc1.bias [12]",
        "mlp.fc2.weight [8, 12]",
        "mlp.fc2.bias [8]",
        "ls2.gamma [8]",
    ]
    .iter()
    .map(|name| format!("frame_blocks.0.{name}"))
    .collect();
    expected.sort();
    assert_eq!(found, expected);
}

#[test]
fn options_leave_parameters_out() {
    let mut params = Params::<f64>::new();
    Block::new(Builder::new(&mut params, 0), &BlockConfig { layer_scale: None, qk_norm: false, ..CONFIG });
    assert_eq!(params.len(), 12);
    let mut params = Params::<f64>::new();
    Linear::without_bias(Builder::new(&mut params, 0).scope("a"), 2, 3, WeightInit::FanIn);
    Conv2d::without_bias(Builder::new(&mut params, 0).scope("b"), 2, 3, 5, WeightInit::FanIn);
    assert_eq!(names(&params), ["a.weight [3, 2]", "b.weight [3, 2, 5, 5]"]);
}

/// Softmax attention written out, one query at a time.
fn attention_twin(attention: &Attention, params: &Params<f64>, x: &[f64], tokens: usize) -> Vec<f64> {
    let (width, heads) = (8, attention.heads);
    let head = width / heads;
    let value = |id| params.get(id).value();
    let apply = |layer: &Linear, x: &[f64]| -> Vec<f64> {
        let (w, b) = (value(layer.weight), value(layer.bias.expect("a bias")));
        let rows = x.chunks(width);
        rows.flat_map(|x| {
            b.iter().enumerate().map(|(o, b)| b + (0..width).map(|i| w[o * width + i] * x[i]).sum::<f64>())
        })
        .collect()
    };
    let norm = |layer: &LayerNorm, x: &[f64]| -> Vec<f64> {
        let mean = x.iter().sum::<f64>() / head as f64;
        let variance = x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / head as f64;
        let scaled = x.iter().map(|x| (x - mean) / (variance + layer.eps).sqrt());
        scaled.zip(value(layer.weight)).zip(value(layer.bias.expect("a bias"))).map(|((x, w), b)| x * w + b).collect()
    };
    let qkv = apply(&attention.qkv, x);
    let part = |token: usize, which: usize, h: usize| &qkv[(token * 3 + which) * width + h * head..][..head];
    let (q_norm, k_norm) = attention.norms.as_ref().expect("normalized queries and keys");
    let mut y = vec![0.0; tokens * width];
    for (token, h) in (0..tokens).flat_map(|t| (0..heads).map(move |h| (t, h))) {
        let q = norm(q_norm, part(token, 0, h));
        let score =
            |t| q.iter().zip(norm(k_norm, part(t, 1, h))).map(|(q, k)| q * k).sum::<f64>() / (head as f64).sqrt();
        let weights: Vec<f64> = (0..tokens).map(|t| score(t).exp()).collect();
        let total: f64 = weights.iter().sum();
        for (t, weight) in weights.iter().enumerate() {
            (0..head).for_each(|i| y[token * width + h * head + i] += weight / total * part(t, 2, h)[i]);
        }
    }
    apply(&attention.proj, &y)
}

#[test]
fn attention_agrees_with_its_definition() {
    let mut params = Params::<f64>::new();
    let attention = Attention::new(Builder::new(&mut params, 3), 8, 2, true, WeightInit::FanIn);
    let x = Input::normal(1, [1, 5, 8]);
    let tape = Tape::new();
    let y = attention.forward(Context::new(&tape, &params), tape.constant(&x.data, x.shape), None).to_vec();
    for (y, e) in y.iter().zip(attention_twin(&attention, &params, &x.data, 5)) {
        assert!((y - e).abs() < 1e-12);
    }
    // Tokens that are all at the origin are not turned.
    let still = RopeTable::new(&[[0, 0]; 5], 4, 100.0);
    let turned =
        attention.forward(Context::new(&tape, &params), tape.constant(&x.data, x.shape), Some(&still)).to_vec();
    assert_eq!(y, turned);
}

/// Checks the gradient of `f` with respect to x and to every parameter: x becomes a parameter, too.
fn check<F>(mut params: Params<f64>, x: Input, f: F)
where
    F: for<'t> Fn(Context<'t, '_, f64>, Var<'t, f64>) -> Var<'t, f64>,
{
    let x = params.add("x", x.shape, x.data);
    let loss = |params: &Params<f64>| {
        let tape = Tape::new();
        let cx = Context::new(&tape, params);
        let y = f(cx, cx.param(x));
        y.to_vec().iter().zip(Input::normal(5, y.shape()).data).map(|(y, c)| y * c).sum::<f64>()
    };
    let tape = Tape::new();
    let cx = Context::new(&tape, &params);
    let y = f(cx, cx.param(x));
    y.backward_with(&Input::normal(5, y.shape()).data);
    for (id, param) in params.iter() {
        let gradient = tape.param_grad(id).unwrap_or_else(|| panic!("{} got no gradient", param.name()));
        for at in [0, gradient.len() / 2, gradient.len() - 1] {
            let moved = |by: f64| {
                let mut params = params.clone();
                params.value_mut(id)[at] += by;
                loss(&params)
            };
            let numeric = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            let error = (numeric - gradient[at]).abs() / gradient[at].abs().max(1.0);
            assert!(
                error < 1e-6,
                "{} element {at}: {} by the tape, {numeric} by differences",
                param.name(),
                gradient[at]
            );
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 32, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn block_gradients(batch in 1usize..3, tokens in 1usize..5, scaled: bool, normed: bool, seed: u64) {
        let mut params = Params::<f64>::new();
        let config = BlockConfig { layer_scale: scaled.then_some(0.3), qk_norm: normed, ..CONFIG };
        let block = Block::new(Builder::new(&mut params, seed), &config);
        let positions: Vec<_> = (0..tokens).map(|t| [t / 2, t % 2]).collect();
        let table = std::sync::Arc::new(RopeTable::new(&positions, 4, 100.0));
        check(params, Input::normal(seed, [batch, tokens, 8]), |cx, x| block.forward(cx, x, Some(&table)));
    }

    #[test]
    fn convolution_gradients(h in 2usize..5, w in 2usize..5, seed: u64) {
        let mut params = Params::<f64>::new();
        let mut builder = Builder::new(&mut params, seed);
        let down = Conv2d::new(builder.scope("down"), 2, 3, 3, WeightInit::FanIn).with_stride(2);
        let up = ConvTranspose2d::new(builder.scope("up"), 3, 2, 2, WeightInit::FanIn);
        check(params, Input::normal(seed, [2, 2, h, w]), |cx, x| up.forward(cx, down.forward(cx, x)));
    }

    #[test]
    fn mlp_gradients(rows in 1usize..4, seed: u64) {
        let mut params = Params::<f64>::new();
        let mlp = Mlp::new(Builder::new(&mut params, seed), 3, 5, 2, WeightInit::FanIn);
        check(params, Input::normal(seed, [rows, 3]), |cx, x| mlp.forward(cx, x));
    }
}

#[test]
fn a_block_is_the_sum_of_its_branches() {
    let mut params = Params::<f64>::new();
    let block = Block::new(Builder::new(&mut params, 7), &CONFIG);
    let id = |name: &str| params.find(name).expect("a parameter of the block");
    let tape = Tape::new();
    let cx = Context::new(&tape, &params);
    let input = Input::normal(2, [2, 3, 8]);
    let x = tape.constant(&input.data, input.shape);
    let norm = |name: &str| (cx.param(id(&format!("{name}.weight"))), cx.param(id(&format!("{name}.bias"))));
    let mut other = Params::<f64>::new();
    let attention = Attention::new(Builder::new(&mut other, 7).scope("attn"), 8, 2, true, CONFIG.init);
    let second_tape = Tape::new();
    let inner = second_tape.constant(&x.layer_norm(Some(norm("norm1")), 1e-5).to_vec(), x.shape());
    let attended = attention.forward(Context::new(&second_tape, &other), inner, None).to_vec();
    let x1 = x + tape.constant(&attended, x.shape()) * 0.3;
    let hidden = ops::linear(
        x1.layer_norm(Some(norm("norm2")), 1e-5),
        cx.param(id("mlp.fc1.weight")),
        Some(cx.param(id("mlp.fc1.bias"))),
        ops::Activation::Gelu,
    );
    let second = hidden.matmul_with(cx.param(id("mlp.fc2.weight")), false, true) * 0.3;
    for (y, e) in block.forward(cx, x, None).to_vec().iter().zip((x1 + second).to_vec()) {
        assert!((y - e).abs() < 1e-12);
    }
}
