//! Ten thousand Gaussians of each model at one time, and a step of a router of two experts, forward and backward.
// The macros of criterion define functions without documentation.
#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use weaver_autograd::{Params, Tape};
use weaver_dynamic::{
    Code, CodeConfig, Field, FieldConfig, Keys, KeysConfig, Motion, PixelRouter, Poly, RouterConfig, Shot, Start,
    photometric,
};
use weaver_kernels::random::Stream;
use weaver_nn::{Builder, Context};
use weaver_pose::CameraVars;
use weaver_splat::{GaussianVars, RasterSettings, Workspace, WorkspacePool};

const COUNT: usize = 10_000;

fn bench(c: &mut Criterion) {
    let positions: Vec<f64> = (0..3 * COUNT).map(|i| (i as f64 * 0.731).sin()).collect();
    let start = Start { positions: &positions, sizes: &[0.05; COUNT], opacity: 0.1 };
    let mut params = Params::<f32>::new();
    let mut root = Builder::new(&mut params, 0);
    let bounds = [[-1.0; 3], [1.0; 3]];
    let field = FieldConfig { bounds, resolution: [16, 16, 8, 16], levels: 2, channels: 8, width: 32 };
    let code = CodeConfig { code: 8, table: [16, 16], moments: [4, 16], width: 32, neighbors: 20 };
    let keys = KeysConfig { frames: 32, interval: 4, pad: 0.0, margin: 3.0 };
    let models: [(&str, Box<dyn Motion<f32>>); 4] = [
        ("field", Box::new(Field::new(root.scope("field"), &start, field))),
        ("code", Box::new(Code::new(root.scope("code"), &start, code))),
        ("keys", Box::new(Keys::new(root.scope("keys"), &start, keys))),
        ("poly", Box::new(Poly::new(root.scope("poly"), &start, &[0.5; COUNT]))),
    ];
    let mut tape = Tape::new();
    let mut group = c.benchmark_group("dynamic");
    for (name, model) in models {
        group.bench_function(name, |b| {
            b.iter(|| {
                tape.reset();
                let moved = model.at(Context::new(&tape, &params), 0.3);
                (moved.means.sum() + moved.quats.sum() + moved.scales.sum() + moved.opacities.sum()).backward();
            });
        });
    }
}

/// A step on 96 x 72 pixels, by drawing and by cached renders.
fn router(c: &mut Criterion) {
    let owners: Vec<usize> = (0..COUNT).map(|i| i % 2).collect();
    let mut params = Params::<f32>::new();
    let router = PixelRouter::new(Builder::new(&mut params, 0), &owners, RouterConfig::default());
    let (mut tape, workspaces) = (Tape::new(), WorkspacePool::new());
    let stream = Stream::new(3, 0, "dynamic.bench");
    let uniform = |purpose: u64, len: usize| (0..len as u64).map(|i| stream.fork(purpose).uniform::<f32>(i)).collect();
    let (places, colors): (Vec<f32>, Vec<f32>) = (uniform(0, 3 * COUNT), uniform(1, 3 * COUNT));
    let means: Vec<f32> = places.chunks(3).flat_map(|p| [2.0 * p[0] - 1.0, 1.5 * p[1] - 0.75, 2.0 + p[2]]).collect();
    let kept = {
        let (gaussians, shot) = scene(&tape, &workspaces, &means, &colors);
        router.see(&gaussians, &shot, &mut Workspace::new()).expect("a scene that fits together")
    };
    let mut group = c.benchmark_group("a router's step");
    for (name, again) in [("by drawing", false), ("by what was kept", true)] {
        group.bench_function(name, |b| {
            b.iter(|| {
                tape.reset();
                let cx = Context::new(&tape, &params);
                let (gaussians, shot) = scene(&tape, &workspaces, &means, &colors);
                let gated = match again {
                    true => router.gated_again(cx, &kept, &shot),
                    false => router.gated(cx, &gaussians, &shot),
                };
                photometric(gated.image, gated.images.slice(0, 0, 1).reshape([72 * 96, 3]), [72, 96]).backward();
            });
        });
    }
}

/// Constant Gaussians in front of a camera.
fn scene<'a, 't>(
    tape: &'t Tape<f32>,
    workspaces: &'a WorkspacePool<f32>,
    means: &[f32],
    colors: &[f32],
) -> (GaussianVars<'t, f32>, Shot<'a, 't, f32>) {
    let gaussians = GaussianVars {
        means: tape.constant(means, [COUNT, 3]),
        quats: tape.constant(&[1.0, 0.0, 0.0, 0.0].repeat(COUNT), [COUNT, 4]),
        scales: tape.constant(&[0.03; 3 * COUNT], [COUNT, 3]),
        opacities: tape.constant(&[0.3; COUNT], [COUNT]),
        colors: tape.constant(colors, [COUNT, 3]),
    };
    let viewmat = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let shot = Shot {
        camera: CameraVars {
            viewmats: tape.constant(&viewmat, [1, 3, 4]),
            intrinsics: tape.constant(&[96.0, 96.0, 48.0, 36.0], [1, 4]),
        },
        time: 0.3,
        size: [72, 96],
        background: tape.constant(&[0.0; 3], [3]),
        settings: RasterSettings::default(),
        workspaces,
    };
    (gaussians, shot)
}

criterion_group!(benches, bench, router);
criterion_main!(benches);
