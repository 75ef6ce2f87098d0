//! The appearance expert at its small size, four views of 64 x 48: forward, and backward too.
// The macros of criterion define functions without documentation.
#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use weaver_autograd::gradcheck::Input;
use weaver_autograd::{Params, Tape};
use weaver_nn::{Builder, Context};
use weaver_pose::CameraVars;
use weaver_two_experts::{OpacityDegree, Parametrization, Pyramid, PyramidConfig};

fn pyramid(c: &mut Criterion) {
    let config = PyramidConfig {
        patch: 4,
        width: 32,
        blocks: [1, 2, 2],
        head: 16,
        mlp_ratio: 4,
        registers: 2,
        group: 2,
        features: 48,
        cameras: true,
        world_rays: true,
        opacity: OpacityDegree::Constant,
        gain: 0.3,
    };
    let mut params = Params::<f32>::new();
    let network = Pyramid::new(Builder::new(&mut params, 0), config);
    let photos: Vec<f32> = Input::uniform(1, 0.0, 1.0, [4 * 3 * 48 * 64]).data.iter().map(|x| *x as f32).collect();
    let at = |v: usize| [1.0, 0.0, 0.0, 0.1 * v as f32, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let viewmats: Vec<f32> = (0..4).flat_map(at).collect();
    let mut tape = Tape::<f32>::new();
    let mut run = |backward: bool| {
        {
            let photos = tape.constant(&photos, [4, 3, 48, 64]);
            let cameras = CameraVars {
                viewmats: tape.leaf(&viewmats, [4, 3, 4]),
                intrinsics: tape.constant(&[60.0, 60.0, 32.0, 24.0].repeat(4), [4, 4]),
            };
            let (raw, _) = network.forward(Context::new(&tape, &params), photos, &cameras);
            let (gaussians, _) = raw.gaussians(Parametrization::Footprint { scale: 0.7 }, cameras.intrinsics, photos);
            let loss = gaussians.means.sum() + gaussians.colors.sum();
            if backward {
                loss.backward();
            }
            black_box(loss.item());
        }
        tape.reset();
    };
    let mut group = c.benchmark_group("appearance expert, 4 x 48 x 64");
    group.sample_size(10);
    group.bench_function("forward", |b| b.iter(|| run(false)));
    group.bench_function("forward and backward", |b| b.iter(|| run(true)));
}

criterion_group!(benches, pyramid);
criterion_main!(benches);
