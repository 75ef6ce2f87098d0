//! Wrong shapes are refused with the name of the op or layer, the model path, and the shapes found.

use std::panic::{AssertUnwindSafe, catch_unwind};
use weaver_autograd::{Params, Tape, Var};
use weaver_nn::{Builder, Context};
use weaver_vggt::{
    Aggregator, AggregatorConfig, BackboneInit, DenseTokens, DptConfig, DptHead, VisionTransformerConfig,
};

/// The message for inputs of these shapes in a part of a model called `backbone`.
fn message<const N: usize>(
    params: &Params<f64>,
    shapes: [&[usize]; N],
    call: impl for<'t> Fn(Context<'t, '_, f64>, [Var<'t, f64>; N]),
) -> String {
    let tape = Tape::new();
    let inputs = shapes.map(|s| tape.constant(&vec![0.5; s.iter().product()], s));
    let cx = Context::new(&tape, params);
    let backbone = || cx.part("backbone", || call(cx, inputs));
    let panic = catch_unwind(AssertUnwindSafe(backbone)).expect_err("shapes that do not fit are refused");
    *panic.downcast::<String>().expect("a formatted message")
}

#[test]
fn messages_name_op_path_and_shapes() {
    let mut params = Params::new();
    let encoder =
        VisionTransformerConfig { patch: 2, dim: 8, depth: 1, heads: 2, mlp_ratio: 1, registers: 1, table: [2, 2] };
    let config = AggregatorConfig { encoder, rounds: 1, heads: 2, mlp_ratio: 1, registers: 1, layers: vec![0] };
    let mut b = Builder::new(&mut params, 0);
    let aggregator = Aggregator::new(b.scope("aggregator"), config, BackboneInit::FROM_SCRATCH);
    let config = DptConfig { dim: 4, out_channels: [4, 4, 8, 4], features: 4, width: 8 };
    let head = DptHead::new(&mut b.scope("depth_head"), config);

    let images = |shape: &[usize]| message(&params, [shape], |cx, [x]| drop(aggregator.forward(cx, x)));
    assert_eq!(
        images(&[2, 3, 4, 4]),
        "backbone: aggregator: expected images [B, V, 3, H, W] of at least one view, found [2, 3, 4, 4]"
    );
    assert_eq!(
        images(&[1, 2, 3, 4, 5]),
        "backbone.patch_embed.patch_embed: patch_embed: expected images [N, 3, H, W] with sides that are multiples of 2, \
         found [2, 3, 4, 5]"
    );
    let layers = message(&params, [&[2, 3, 4], &[2, 5, 4]], |cx, x| {
        head.fuse(cx, DenseTokens { layers: &x, special: 1, grid: [1, 2], image: [4, 8] });
    });
    assert_eq!(
        layers,
        "backbone: dense_head: expected four layers of tokens [B, V, tokens, 2 D], found [2, 3, 4], [2, 5, 4]"
    );
}
