//! Passes of the solvers over one view, and clusters.

use criterion::{BenchmarkId, Criterion, Throughput};
use std::hint::black_box;
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_kernels::random::Stream;
use weaver_lift::{HdbscanOptions, LiftOptions, Maps, Pca, Raster, Solver, hdbscan, lift};
use weaver_scene::ActivatedGaussians;
use weaver_splat::RasterSettings;

const SPLATS: usize = 20_000;
const SIZE: [usize; 2] = [320, 240];

fn scene() -> (ActivatedGaussians, Camera) {
    let stream = Stream::new(1, 0, "bench.lift");
    let normal = |i: usize| stream.normal::<f32>(i as u64);
    let scene = ActivatedGaussians {
        means: (0..3 * SPLATS).map(|i| if i % 3 == 2 { 3.0 + 0.5 * normal(i) } else { normal(i) }).collect(),
        scales: vec![0.02; 3 * SPLATS],
        quats: [1.0, 0.0, 0.0, 0.0].repeat(SPLATS),
        opacities: vec![0.7; SPLATS],
        sh: vec![0.0; 3 * SPLATS],
        degree: 0,
    };
    let intrinsics = Intrinsics { fx: 280.0, fy: 280.0, cx: 160.0, cy: 120.0 };
    (scene, Camera { pose: Pose::IDENTITY, intrinsics, width: SIZE[0], height: SIZE[1] })
}

fn solvers(criterion: &mut Criterion) {
    let (scene, camera) = scene();
    let mut group = criterion.benchmark_group("one view of 320 x 240, 20,000 Gaussians");
    group.sample_size(10);
    for channels in [8, 64] {
        let values = vec![0.5_f32; SIZE[0] * SIZE[1] * channels];
        group.throughput(Throughput::Bytes(size_of_val(&values[..]) as u64));
        let mut maps = Maps { views: vec![values], channels };
        for (name, solver) in
            [("row sum", Solver::RowSum), ("squared", Solver::Squared), ("exact, 5 passes", Solver::exact(5))]
        {
            let cameras = [camera];
            let mut raster = Raster::new(scene.as_slices(), &cameras, RasterSettings::default());
            let options = LiftOptions::with(solver);
            group.bench_function(BenchmarkId::new(name, channels), |b| {
                b.iter(|| black_box(lift(&mut raster, &mut maps, &options, &mut || ()).map(|lifted| lifted.passes)));
            });
        }
    }
    group.finish();
}

fn clusters(criterion: &mut Criterion) {
    let stream = Stream::new(2, 0, "bench.clusters");
    let points: Vec<f64> = (0..50 * 3000).map(|i| stream.normal::<f64>(i) + (i / 50 % 6 * 5) as f64).collect();
    let mut group = criterion.benchmark_group("3000 points of 50 numbers");
    group.sample_size(10);
    group.bench_function("principal components", |b| b.iter(|| black_box(Pca::of(&points, 50, 50))));
    let options = HdbscanOptions { smallest: 30, samples: 10, resolution: 0.0 };
    group.bench_function("hdbscan", |b| b.iter(|| black_box(hdbscan(&points, 50, &options))));
    group.finish();
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    solvers(&mut criterion);
    clusters(&mut criterion);
    criterion.final_summary();
}
