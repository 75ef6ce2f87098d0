//! Unprojection and pose decoding, forward and backward on the tape.
// The macros of criterion define functions without documentation.
#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::Input;

fn unproject(c: &mut Criterion) {
    let (views, height, width) = (4, 48, 64);
    let depth: Vec<f32> = (0..views * height * width).map(|i| 1.0 + (i % 7) as f32 * 0.1).collect();
    let codes: Vec<f32> = Input::uniform(1, 0.5, 1.0, [views, 9]).data.iter().map(|x| *x as f32).collect();
    let cotangent = vec![1.0_f32; views * height * width * 3];
    let mut tape = Tape::<f32>::new();
    c.bench_function("unproject 4 x 48 x 64, forward and backward", |b| {
        b.iter(|| {
            {
                let depth = tape.leaf(&depth, [views, height, width]);
                let cameras = weaver_pose::cameras(tape.leaf(&codes, [views, 9]), height, width);
                let points = weaver_pose::unproject(depth, cameras.viewmats, cameras.intrinsics, 0.5);
                points.backward_with(&cotangent);
                black_box(depth.grad());
            }
            tape.reset();
        });
    });
}

fn plane_sweep(c: &mut Criterion) {
    let (views, height, width, channels) = (4, 48, 64, 8);
    let numbers =
        |seed, n: usize| -> Vec<f32> { Input::uniform(seed, 0.5, 1.0, [n]).data.iter().map(|x| *x as f32).collect() };
    let (features, depth) = (numbers(1, views * height * width * channels), numbers(2, views * height * width));
    // Side by side: all of them see nearly everything.
    let shift = |v: usize| [1.0, 0.0, 0.0, 0.05 * v as f32, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let viewmats: Vec<f32> = (0..views).flat_map(shift).collect();
    let intrinsics = [64.0, 64.0, 32.0, 24.0].repeat(views);
    let factors: Vec<f64> = (0..17).map(|k| 1.05_f64.powi(k - 8)).collect();
    let mut tape = Tape::<f32>::new();
    c.bench_function("plane sweep 4 x 48 x 64, 8 channels, 17 depths, forward and backward", |b| {
        b.iter(|| {
            {
                let features = tape.leaf(&features, [views, height, width, channels]);
                let depth = tape.constant(&depth, [views, height, width]);
                let viewmats = tape.constant(&viewmats, [views, 3, 4]);
                let intrinsics = tape.constant(&intrinsics, [views, 4]);
                weaver_pose::plane_sweep(features, depth, viewmats, intrinsics, &factors, 0.5).sum().backward();
                black_box(features.grad());
            }
            tape.reset();
        });
    });
}

criterion_group!(benches, unproject, plane_sweep);
criterion_main!(benches);
