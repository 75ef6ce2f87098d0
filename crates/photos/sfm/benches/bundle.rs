//! Bundle adjustment of cameras around a scene: time of a step, and of all until nothing is left to gain.

use criterion::{BatchSize, Criterion};
use std::hint::black_box;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, Pose, se3, so3};
use weaver_kernels::random::Stream;
use weaver_sfm::{Bundle, Lens, Observation};

/// Steps of the row that times a single step.
const STEPS: usize = 4;
/// Difference, in pixels, beyond which observations count for less and less.
const SCALE: f64 = 4.0;

/// Cameras on a circle, each point seen by some that follow each other; all a little wrong.
fn ring(cameras: usize, points: usize, seen: usize) -> Bundle {
    let stream = Stream::new(1, cameras as u64, "bench.bundle");
    let normal = |k: usize| stream.normal::<f64>(k as u64);
    let draw = |k: usize| DVec3::new(normal(k), normal(k + 1), normal(k + 2));
    let intrinsics = Intrinsics { fx: 1200.0, fy: 1200.0, cx: 800.0, cy: 600.0 };
    let truth = |i: usize| {
        let turn = so3::exp(DVec3::Y * (i as f64 / cameras as f64 * std::f64::consts::TAU));
        let pose = Pose::new(so3::exp(draw(3 * i) * 0.1) * turn, DVec3::new(0.0, 0.0, 6.0));
        Camera { pose, intrinsics, width: 1600, height: 1200 }
    };
    let mut bundle = Bundle {
        cameras: (0..cameras).map(truth).collect(),
        lenses: vec![Lens { free_focal: true, free_k1: true, ..Lens::default() }],
        lens_of: vec![0; cameras],
        fixed: vec![false; cameras],
        ..Bundle::default()
    };
    for point in 0..points {
        let at = 10_000 + 100 * point;
        let position = draw(at) * 0.7;
        let first = (stream.uniform::<f64>(at as u64 + 50) * cameras as f64) as usize;
        let mut seeing: Vec<usize> = (0..seen).map(|k| (first + k * (1 + point % 3)) % cameras).collect();
        seeing.sort_unstable();
        seeing.dedup();
        for (k, camera) in seeing.into_iter().enumerate() {
            let noise = draw(at + 3 + 3 * k).truncate() * 0.5;
            let from = &bundle.cameras[camera];
            let pixel = bundle.lenses[0].project(from, from.pose.apply(position)) + noise;
            bundle.observations.push(Observation { camera, point, pixel, deviation: 1.0 });
        }
        bundle.points.push(position + draw(at + 90) * 0.02);
    }
    for (i, camera) in bundle.cameras.iter_mut().enumerate() {
        let by = |k: u64| draw(1_000_000_000 + 6 * i + 3 * k as usize) * 0.01;
        camera.pose = se3::exp(by(0), by(1)).compose(&camera.pose);
    }
    bundle
}

fn bundles(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("bundle");
    group.sample_size(10);
    for (cameras, points, seen) in [(12, 3000, 4), (50, 10_000, 6), (300, 60_000, 7), (1000, 300_000, 5)] {
        let start = ring(cameras, points, seen);
        let name = format!("{cameras} cameras, {points} points, {} seen", start.observations.len());
        let mut row = |steps: usize| {
            let mut end = None;
            group.bench_function(format!("{name}, at most {steps} steps"), |b| {
                let adjust = |mut bundle: Bundle| {
                    end = Some(bundle.adjust(SCALE, steps));
                    black_box(bundle)
                };
                b.iter_batched(|| start.clone(), adjust, BatchSize::LargeInput)
            });
            end.iter().for_each(|end| println!("{end:?}"));
        };
        [0, STEPS, 100].into_iter().for_each(&mut row);
    }
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    bundles(&mut criterion);
    criterion.final_summary();
}
