//! The backbone and a dense head at the size of the tiny preset, four views of 64 x 48: forward, and backward too.
// The macros of criterion define functions without documentation.
#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use weaver_autograd::gradcheck::Input;
use weaver_autograd::{Params, Tape};
use weaver_nn::{Builder, Context, WeightInit};
use weaver_vggt::{
    Aggregator, AggregatorConfig, BackboneInit, DenseTokens, DepthHead, DepthHeadConfig, DptConfig,
    VisionTransformerConfig,
};

fn backbone(c: &mut Criterion) {
    let encoder =
        VisionTransformerConfig { patch: 8, dim: 96, depth: 2, heads: 3, mlp_ratio: 4, registers: 2, table: [6, 8] };
    let config =
        AggregatorConfig { encoder, rounds: 4, heads: 3, mlp_ratio: 4, registers: 2, layers: vec![0, 1, 2, 3] };
    let dpt = DptConfig { dim: 192, out_channels: [24, 48, 96, 96], features: 32, width: 32 };
    let last = WeightInit::TruncatedNormal(0.02);
    let depth = DepthHeadConfig { dpt, hidden: 32, log_depth_bounds: Some((-4.0, 4.0)), last };
    let mut params = Params::<f32>::new();
    let mut b = Builder::new(&mut params, 0);
    let aggregator = Aggregator::new(b.scope("aggregator"), config, BackboneInit::FROM_SCRATCH);
    let head = DepthHead::new(b.scope("depth_head"), depth);
    let images: Vec<f32> = Input::uniform(1, 0.0, 1.0, [4 * 3 * 48 * 64]).data.iter().map(|x| *x as f32).collect();
    let mut tape = Tape::<f32>::new();
    let mut run = |backward: bool| {
        {
            let cx = Context::new(&tape, &params);
            let out = aggregator.forward(cx, tape.constant(&images, [1, 4, 3, 48, 64]));
            let tokens = DenseTokens { layers: &out.layers, special: out.special, grid: out.grid, image: [48, 64] };
            let loss = head.forward(cx, tokens).depth.sum();
            if backward {
                loss.backward();
            }
            black_box(loss.item());
        }
        tape.reset();
    };
    let mut group = c.benchmark_group("aggregator and depth head, 4 x 48 x 64");
    group.sample_size(10);
    group.bench_function("forward", |b| b.iter(|| run(false)));
    group.bench_function("forward and backward", |b| b.iter(|| run(true)));
}

criterion_group!(benches, backbone);
criterion_main!(benches);
