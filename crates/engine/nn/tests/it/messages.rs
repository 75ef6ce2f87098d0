//! The message of a layer about an input of the wrong shape: the place in the model, the op, the expected and the found
//! shape.

use std::panic::{AssertUnwindSafe, catch_unwind};
use weaver_autograd::{Params, Tape, Var};
use weaver_nn::{
    Attention, Block, BlockConfig, Builder, Context, Conv2d, ConvTranspose2d, LayerNorm, Linear, Mlp, WeightInit,
};

/// Takes a result that never comes.
fn done<X>(_: X) {}

fn message(params: &Params<f64>, shape: &[usize], run: impl for<'t> Fn(Context<'t, '_, f64>, Var<'t, f64>)) -> String {
    let tape = Tape::new();
    let x = tape.constant(&vec![0.5; shape.iter().product()], shape);
    let model = || tape.part("model", || run(Context::new(&tape, params), x));
    let panic = catch_unwind(AssertUnwindSafe(model));
    *panic.expect_err("the shape is refused").downcast::<String>().expect("a formatted message")
}

#[test]
fn messages_name_the_layer_by_its_parameters() {
    let (mut params, init) = (Params::new(), WeightInit::FanIn);
    let mut root = Builder::new(&mut params, 0);
    let mut encoder = root.scope("encoder");
    let qkv = Linear::new(encoder.scope("block.3.attn.qkv"), 4, 12, init);
    let norm = LayerNorm::new(encoder.scope("norm"), 4, 1e-5);
    let patch = Conv2d::new(encoder.scope("patch"), 3, 4, 2, init);
    let up = ConvTranspose2d::new(encoder.scope("up"), 4, 3, 2, init);
    let mlp = Mlp::new(encoder.scope("mlp"), 4, 8, 4, init);
    let attn = Attention::new(encoder.scope("attn"), 4, 2, false, init);
    let config = BlockConfig { width: 4, heads: 2, hidden: 8, eps: 1e-5, layer_scale: Some(0.1), qk_norm: false, init };
    let block = Block::new(encoder.scope("block.5"), &config);
    let of = |shape: &[usize], run: &dyn for<'t> Fn(Context<'t, '_, f64>, Var<'t, f64>)| message(&params, shape, run);
    let cases = [
        (
            of(&[2, 3], &|cx, x| done(qkv.forward(cx, x))),
            "encoder.block.3.attn.qkv: linear: expected x [.., in], w [out, in], b [out], found [2, 3], [12, 4], [12]",
        ),
        (
            of(&[2, 3], &|cx, x| done(norm.forward(cx, x))),
            "encoder.norm: layer_norm: expected x [.., D], w [D], b [D], found [2, 3], [4], [4]",
        ),
        (
            of(&[1, 2, 4, 4], &|cx, x| done(patch.forward(cx, x))),
            "encoder.patch: conv2d: expected x [N, C, H, W], w [O, C, kh, kw], b [O], found [1, 2, 4, 4], [4, 3, 2, 2], [4]",
        ),
        (
            of(&[1, 2, 4, 4], &|cx, x| done(up.forward(cx, x))),
            "encoder.up: conv_transpose2d: expected x [N, I, H, W], w [I, O, kh, kw], b [O], found [1, 2, 4, 4], [4, 3, 2, 2], [3]",
        ),
        (
            of(&[2, 3], &|cx, x| done(mlp.forward(cx, x))),
            "encoder.mlp.fc1: linear: expected x [.., in], w [out, in], b [out], found [2, 3], [8, 4], [8]",
        ),
        (
            of(&[2, 4], &|cx, x| done(attn.forward(cx, x, None))),
            "encoder.attn: attention: expected x [B, N, 4], found [2, 4]",
        ),
        (
            of(&[1, 2, 3], &|cx, x| done(block.forward(cx, x, None))),
            "encoder.block.5.norm1: layer_norm: expected x [.., D], w [D], b [D], found [1, 2, 3], [4], [4]",
        ),
    ];
    for (found, expected) in cases {
        assert_eq!(found, expected);
    }
}

#[test]
fn a_layer_without_a_name_keeps_the_path() {
    let mut params = Params::new();
    let layer = Linear::new(Builder::new(&mut params, 0), 4, 2, WeightInit::FanIn);
    let found = message(&params, &[3], |cx, x| done(layer.forward(cx, x)));
    assert!(found.starts_with("model: linear: "), "{found}");
}
