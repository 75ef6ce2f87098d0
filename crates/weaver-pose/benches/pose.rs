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

criterion_group!(benches, unproject);
criterion_main!(benches);
