//! The first adapter: the sort by itself, forward, forward with backward, transfers included.

#![allow(missing_docs)] // criterion_group! makes an undocumented function

#[path = "../../../scene/splat/tests/it/scene.rs"]
#[allow(dead_code, reason = "the scenes of the CPU's tests, which need more of them")]
mod scene;

use criterion::{Criterion, criterion_group, criterion_main};
use scene::Scene;
use weaver_gpu::{Choice, Context, GpuRasterizer, sort_pairs};
use weaver_splat::{Cotangents, Gradients, Images, Target};

fn benches(c: &mut Criterion) {
    let Ok(context) = Context::open(&Choice::Number(0)) else { return };
    let mut group = c.benchmark_group(context.adapter().to_string());
    group.sample_size(10);
    let keys: Vec<u32> = (0..100_000_u32).map(|i| i.wrapping_mul(2_654_435_761)).collect();
    group.bench_function("sort 100,000 pairs", |b| {
        b.iter(|| {
            let (mut keys, mut values) = (keys.clone(), keys.clone());
            sort_pairs(&context, &mut keys, &mut values, 32).expect("there is room for them");
        });
    });
    let rasterizer = GpuRasterizer::new(context);
    let scene = Scene::random(1, 5000, 1, (320, 240), Some(3)).with_channels(0).to_f32();
    let (mut image, mut alpha) = (vec![0.0; 3 * scene.pixels()], vec![0.0; scene.pixels()]);
    let mut means = vec![0.0; scene.means.len()];
    let mut workspace = rasterizer.workspace();
    for backward in [false, true] {
        group.bench_function(if backward { "forward and backward" } else { "forward" }, |b| {
            b.iter(|| {
                let (gaussians, cameras) = (scene.gaussians(), scene.cameras());
                let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
                let drawn = rasterizer.forward(&gaussians, &cameras, &scene.settings, &mut workspace, images);
                drawn.expect("the scene fits together");
                if backward {
                    let cotangents = Cotangents { image: Some(&image), ..Cotangents::default() };
                    let targets = Gradients { means: Some(Target::write(&mut means)), ..Gradients::default() };
                    let (settings, workspace) = (&scene.settings, &mut workspace);
                    let done = rasterizer.backward(&gaussians, &cameras, settings, workspace, &cotangents, targets);
                    done.expect("forward came first");
                }
            });
        });
    }
    group.finish();
}

criterion_group!(all, benches);
criterion_main!(all);
