//! The network on four photos of 128 x 96 pixels: comparison, one pass, and a step forward and back.

// The macros of criterion define functions without documentation.
#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use weaver_autograd::{Params, Tape};
use weaver_data::View;
use weaver_geometry::Camera;
use weaver_inference::{Photos, planar};
use weaver_kernels::random::Stream;
use weaver_nn::Context;
use weaver_photo::{Comparison, PhotoConfig, PhotoNetwork, Prior};
use weaver_procedural::{ProceduralOptions, varied_scene};

fn photo(c: &mut Criterion) {
    let options = ProceduralOptions { width: 128, height: 96, views: 4 };
    let scene = varied_scene(3, &options);
    let planes = planar(scene.views.iter().map(|view| &view.image));
    let photos = Photos { planes: &planes, inside: None, height: 96, width: 128 };
    let first = scene.views[0].camera.pose;
    let relative = |view: &View| Camera { pose: view.camera.pose.relative_to(&first), ..view.camera };
    let cameras: Vec<Camera> = scene.views.iter().map(relative).collect();
    let depth: Vec<f32> = scene.views.iter().flat_map(|view| view.depth.clone().unwrap_or_default()).collect();
    let points = scene.points_seen(&[0, 1, 2, 3], 1.0);
    let mut group = c.benchmark_group("photo");
    group.sample_size(10);
    group.bench_function("comparison", |b| b.iter(|| Comparison::of(photos, &cameras, &points)));
    let stream = Stream::new(0, 0, "bench");
    group
        .bench_function("simulated comparison", |b| b.iter(|| Comparison::simulated(photos, &cameras, &depth, stream)));
    let comparison = Comparison::simulated(photos, &cameras, &depth, stream);
    group.bench_function("prior", |b| b.iter(|| Prior::new(photos, &cameras, &comparison)));
    let prior = Prior::new(photos, &cameras, &comparison);
    let mut params = Params::<f32>::new();
    let network = PhotoNetwork::new(PhotoConfig::preset("photo-128").expect("a preset"), &mut params, 0);
    let mut tape = Tape::new();
    group.bench_function("dense", |b| {
        b.iter(|| {
            tape.reset();
            let cx = Context::new(&tape, &params);
            tape.without_gradient(|| {
                network.dense(cx, &prior, tape.constant(&planes, [4, 3, 96, 128])).log_depth.to_vec()
            })
        });
    });
    group.bench_function("dense and back", |b| {
        b.iter(|| {
            tape.reset();
            let cx = Context::new(&tape, &params);
            let dense = network.dense(cx, &prior, tape.constant(&planes, [4, 3, 96, 128]));
            (dense.log_depth.square().mean() + dense.log_spread.mean() + dense.logits.mean()).backward();
        });
    });
}

criterion_group!(benches, photo);
criterion_main!(benches);
