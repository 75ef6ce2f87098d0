//! A transformer block and an optimizer's step, at the sizes of a small model.

use criterion::Criterion;
use std::hint::black_box;
use std::time::Duration;
use weaver_autograd::{Params, Tape, ops};
use weaver_nn::{AdamW, Block, BlockConfig, Builder, Context, Group, WeightInit};

const TOKENS: usize = 220;
const WIDTH: usize = 96;

/// A block and its parameters.
fn block() -> (Params<f32>, Block) {
    let mut params = Params::new();
    let config = BlockConfig {
        width: WIDTH,
        heads: 3,
        hidden: 4 * WIDTH,
        eps: 1e-5,
        layer_scale: Some(0.1),
        qk_norm: true,
        init: WeightInit::TruncatedNormal(0.02),
    };
    let block = Block::new(Builder::new(&mut params, 0).scope("block"), &config);
    (params, block)
}

fn blocks(c: &mut Criterion) {
    let mut group = c.benchmark_group(format!("block {TOKENS} x {WIDTH}"));
    let (params, block) = block();
    let x: Vec<f32> = (0..TOKENS * WIDTH).map(|i| (0.37 * i as f32).sin()).collect();
    let shape = [1, TOKENS, WIDTH];
    let mut tape = Tape::new();
    group.bench_function("forward", |b| {
        b.iter(|| {
            let x = tape.constant(black_box(&x), shape);
            tape.without_gradient(|| block.forward(Context::new(&tape, &params), x, None));
            tape.reset();
        });
    });
    group.bench_function("forward and backward", |b| {
        b.iter(|| {
            let x = tape.leaf(black_box(&x), shape);
            block.forward(Context::new(&tape, &params), x, None).square().sum().backward();
            tape.reset();
        });
    });
    group.bench_function("forward and backward, recomputed", |b| {
        b.iter(|| {
            let x = tape.leaf(black_box(&x), shape);
            let y = ops::checkpoint(&params, &[x], move |tape, params, x| {
                block.forward(Context::new(tape, params), x[0], None)
            });
            y.square().sum().backward();
            tape.reset();
        });
    });
    group.finish();
}

/// A step on gradients that are there already: the tape is not reset, so every step finds the same ones.
fn adamw(c: &mut Criterion) {
    let (mut params, block) = block();
    let mut tape = Tape::new();
    let x = tape.constant_with([1, TOKENS, WIDTH], |x| x.fill(0.5));
    block.forward(Context::new(&tape, &params), x, None).square().sum().backward();
    let group = Group { params: params.ids().collect(), lr_scale: 1.0, weight_decay: 0.05 };
    let mut optimizer = AdamW::new(vec![group], 0.9, 0.999, 1e-8);
    c.bench_function(&format!("adamw {} parameters", params.count()), |b| {
        b.iter(|| optimizer.step(&mut params, &mut tape, black_box(1e-4)));
    });
}

fn main() {
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(50))
        .measurement_time(Duration::from_millis(200))
        .configure_from_args();
    blocks(&mut criterion);
    adamw(&mut criterion);
    criterion.final_summary();
}
