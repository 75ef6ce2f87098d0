//! A training step of the planted size, the ops, and labels of a long curve.

use criterion::{BenchmarkId, Criterion};
use std::hint::black_box;
use weaver_autograd::{Params, Tape};
use weaver_kernels::random::Stream;
use weaver_nn::{Builder, Context};
use weaver_vad::losses::bag_loss;
use weaver_vad::ops::decay_attention;
use weaver_vad::{Rule, Splatting, UrDmu, UrDmuSizes};

fn numbers(count: usize, low: f32, high: f32) -> Vec<f32> {
    let stream = Stream::new(1, 0, "bench.vad");
    (0..count).map(|i| low + (high - low) * stream.uniform::<f32>(i as u64)).collect()
}

fn step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("UR-DMU, forward and backward");
    group.sample_size(10);
    for (name, sizes, batch, time) in [
        ("planted: width 32, 12 + 12 videos of 64", UrDmuSizes::small(32), 24, 64),
        ("published: width 512, 2 + 2 videos of 200", UrDmuSizes::published(1024), 4, 200),
    ] {
        let mut params = Params::<f32>::new();
        let network = UrDmu::new(Builder::new(&mut params, 0), &sizes);
        let x = numbers(batch * time * sizes.features, -1.0, 1.0);
        let noise = numbers(batch / 2 * time * sizes.width, -1.0, 1.0);
        let mut tape = Tape::<f32>::new();
        group.bench_function(BenchmarkId::from_parameter(name), |b| {
            b.iter(|| {
                let cx = Context::new(&tape, &params);
                let x = tape.constant(&x, [batch, time, sizes.features]);
                let pass = network.pass(cx, x, tape.constant(&noise, [batch / 2, time, sizes.width]), None);
                (bag_loss(pass.encoded.scores) + pass.terms().total()).backward();
                tape.reset();
            });
        });
    }
    group.finish();
}

fn ops(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("24 videos of 200 snippets, forward and backward");
    let (batch, time, width) = (24, 200, 128);
    let x = numbers(batch * time * width, -1.0, 1.0);
    let mut tape = Tape::<f32>::new();
    let mut run = |name: &str, f: &dyn Fn(&Tape<f32>)| {
        group.bench_function(name, |b| {
            b.iter(|| {
                f(&tape);
                tape.reset();
            });
        });
    };
    run("decay_attention", &|tape| decay_attention(tape.leaf(&x, [batch, time, width])).sum().backward());
    group.finish();
}

fn splatting(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("labels of 200 snippets");
    let scores: Vec<f64> = numbers(200, 0.0, 1.0).into_iter().map(f64::from).collect();
    for rule in Rule::ALL {
        let splatting = Splatting::with(rule);
        group.bench_function(rule.letter(), |b| b.iter(|| black_box(splatting.labels(black_box(&scores)))));
    }
    group.finish();
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    step(&mut criterion);
    ops(&mut criterion);
    splatting(&mut criterion);
    criterion.final_summary();
}
