//! Time of an alignment: a photo of 64 x 48, 300 Gaussians, 20 steps of each method.

#![allow(missing_docs)] // criterion_group! makes an undocumented function

use criterion::{Criterion, criterion_group, criterion_main};
use weaver_fit::align::{Method, Options, Photo, Scene, align, mean_square};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, trajectory::look_at};
use weaver_kernels::random::Stream;
use weaver_scene::ActivatedGaussians;
use weaver_splat::{CpuRasterizer, RasterSettings, Workspace, render};

fn bench(criterion: &mut Criterion) {
    let stream = Stream::new(0, 0, "bench");
    let draw = |k: u64, count: usize, low: f32, high: f32| -> Vec<f32> {
        (0..count).map(|i| low + (high - low) * stream.fork(k).uniform::<f32>(i as u64)).collect()
    };
    let n = 300;
    let gaussians = ActivatedGaussians {
        means: draw(0, 3 * n, -1.0, 1.0),
        scales: draw(1, 3 * n, 0.05, 0.2),
        quats: draw(2, 4 * n, -0.5, 0.5),
        opacities: draw(3, n, 0.4, 0.9),
        sh: draw(4, 3 * n, -1.5, 1.5),
        degree: 0,
    };
    let intrinsics = Intrinsics { fx: 56.0, fy: 56.0, cx: 32.0, cy: 24.0 };
    let at = |x: f64| Camera {
        pose: look_at(DVec3::new(x, -0.8, -2.6), DVec3::ZERO, DVec3::NEG_Y),
        intrinsics,
        width: 64,
        height: 48,
    };
    let settings = RasterSettings::default();
    let pixels = render(&gaussians, &[at(1.2)], [0.0; 3], &settings, &mut Workspace::new()).unwrap().concat();
    let scene = Scene { gaussians: gaussians.as_slices(), background: [0.0; 3], settings, unit: 1.0 };
    for method in [Method::Own, Method::NoPoSplat, Method::TwoXplat] {
        let options = Options { steps: 20, ..Options::of(method) };
        let photo = Photo { pixels: &pixels, mask: None, camera: at(1.25) };
        criterion.bench_function(&format!("align, 20 steps, {method:?}"), |bencher| {
            bencher.iter(|| align(&CpuRasterizer, &scene, &[photo], &options, mean_square).unwrap());
        });
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
