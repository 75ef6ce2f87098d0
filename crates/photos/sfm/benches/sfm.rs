//! Features of a photo, matches of two, and adjustment.

use criterion::{BatchSize, Criterion, Throughput};
use std::hint::black_box;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_kernels::random::Stream;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_sfm::{
    Bundle, Epipolar, Features, Lens, Observation, Photo, RefineSettings, View, matches, matches_along, refine,
    two_view,
};

const SIZE: [usize; 2] = [288, 384];

fn views(count: usize) -> Vec<View<'static>> {
    let [height, width] = SIZE;
    let scene = scene(3, &ProceduralOptions { width, height, views: count });
    (scene.views.iter()).map(|view| View::new(view.camera, &view.image.to_bytes(), None)).collect()
}

/// Noise of many scales from 0 to 1, as full of keypoints as photos are at best.
fn texture([height, width]: [usize; 2]) -> Vec<f32> {
    let level = |size: usize| {
        let (columns, stream) = (width / size + 2, Stream::new(size as u64, 0, "bench.texture"));
        let corners: Vec<f32> = (0..columns as u64 * (height / size + 2) as u64).map(|i| stream.uniform(i)).collect();
        move |x: usize, y: usize| {
            let (i, j) = (x / size, y / size);
            let [u, v] = [x % size, y % size].map(|at| at as f32 / size as f32);
            let at = |i: usize, j: usize| corners[j * columns + i];
            (at(i, j) * (1.0 - u) + at(i + 1, j) * u) * (1.0 - v)
                + (at(i, j + 1) * (1.0 - u) + at(i + 1, j + 1) * u) * v
        }
    };
    let levels = [3, 6, 12, 24, 48].map(level);
    (0..width * height).map(|i| levels.iter().map(|level| level(i % width, i / width)).sum::<f32>() / 5.0).collect()
}

/// Throughput in pixels.
fn features(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("features");
    for [height, width] in [[288, 384], [480, 640], [1200, 1600]] {
        let photo = texture([height, width]);
        let count = Features::new(&photo, [height, width], None, 3000).keypoints.len();
        group.throughput(Throughput::Elements((width * height) as u64));
        group.bench_function(format!("{width} x {height}, {count} keypoints"), |b| {
            b.iter(|| black_box(Features::new(&photo, [height, width], None, 3000)));
        });
    }
    group.finish();
}

/// Throughput in pairs of keypoints.
fn pairs(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("matches");
    let size = [600, 800];
    let features = Features::new(&texture(size), size, None, 3000);
    let count = features.keypoints.len();
    let intrinsics = Intrinsics { fx: 800.0, fy: 800.0, cx: 400.0, cy: 300.0 };
    let camera =
        |move_by: DVec3| Camera { pose: Pose::new(Default::default(), move_by), intrinsics, width: 800, height: 600 };
    let epipolar = Epipolar::new(&camera(DVec3::ZERO), &camera(DVec3::new(1.0, 0.4, 0.0)), 6.0);
    group.throughput(Throughput::Elements((count * count) as u64));
    group.bench_function(format!("{count} and {count} keypoints"), |b| {
        b.iter(|| black_box(matches(&features, &features)));
    });
    group.bench_function(format!("{count} and {count} keypoints, 6 pixels from lines"), |b| {
        b.iter(|| black_box(matches_along(&features, &features, &epipolar)));
    });
    group.finish();
}

fn sfm(criterion: &mut Criterion) {
    let views = views(8);
    let stream = Stream::new(1, 0, "bench.pairs");
    let pairs: Vec<[DVec2; 2]> = (0..200)
        .map(|i| {
            let at = DVec2::new(stream.normal(4 * i), stream.normal(4 * i + 1)) * 0.3;
            [at, at + DVec2::new(0.1 / (2.0 + stream.uniform::<f64>(4 * i + 2)), 0.0)]
        })
        .collect();
    criterion.bench_function("two views, 200 matches", |b| b.iter(|| black_box(two_view(&pairs, 1.0 / 400.0))));
    let mut group = criterion.benchmark_group("slow");
    group.sample_size(10);
    group.bench_function("refine, 8 photos", |b| b.iter(|| black_box(refine(&views, &RefineSettings::default()))));
    group.finish();
}

/// Points on a wall that eight photos see, keypoints half a pixel off.
fn align(criterion: &mut Criterion) {
    const POINTS: usize = 2000;
    let stream = Stream::new(1, 0, "bench.align");
    let normal = |k: usize| stream.normal::<f64>(k as u64);
    let [height, width] = SIZE;
    let intrinsics = Intrinsics { fx: 384.0, fy: 384.0, cx: 192.0, cy: 144.0 };
    let camera = |i: usize| {
        let pose = Pose::new(Default::default(), DVec3::new(0.1 * i as f64 - 0.4, 0.0, 4.0));
        Camera { pose, intrinsics, width, height }
    };
    let gray = texture(SIZE);
    let rgb: Vec<u8> = gray.iter().flat_map(|gray| [(255.0 * gray) as u8; 3]).collect();
    let photo = Photo::new(&rgb[..], SIZE);
    let mut bundle = Bundle {
        cameras: (0..8).map(camera).collect(),
        lenses: vec![Lens::default()],
        lens_of: vec![0; 8],
        fixed: vec![false; 8],
        ..Bundle::default()
    };
    for point in 0..POINTS {
        bundle.points.push(DVec3::new(0.6 * normal(4 * point), 0.5 * normal(4 * point + 1), 0.0));
        for camera in 0..8 {
            let off = DVec2::new(normal(10_000 + 8 * point + camera), normal(90_000 + 8 * point + camera)) * 0.5;
            let pixel = intrinsics.project(bundle.cameras[camera].pose.apply(bundle.points[point])) + off;
            bundle.observations.push(Observation { camera, point, pixel, deviation: 1.0 });
        }
    }
    let mut group = criterion.benchmark_group("align");
    group.throughput(Throughput::Elements(bundle.observations.len() as u64));
    group.bench_function(format!("{POINTS} points that 8 photos see"), |b| {
        b.iter_batched(|| bundle.clone(), |mut bundle| bundle.align(&[&photo; 8]), BatchSize::LargeInput);
    });
    group.finish();
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    features(&mut criterion);
    pairs(&mut criterion);
    sfm(&mut criterion);
    align(&mut criterion);
    criterion.final_summary();
}
