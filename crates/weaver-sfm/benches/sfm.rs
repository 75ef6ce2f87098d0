//! Features of a photo, matches of two, and adjustment.

use criterion::Criterion;
use std::hint::black_box;
use weaver_data::procedural::{ProceduralOptions, scene};
use weaver_geometry::glam::DVec2;
use weaver_kernels::random::Stream;
use weaver_sfm::{Features, RefineSettings, View, matches, refine, two_view};

const SIZE: [usize; 2] = [288, 384];

fn views(count: usize) -> Vec<View<'static>> {
    let scene = scene(3, &ProceduralOptions { width: SIZE[1], height: SIZE[0], views: count });
    (scene.views.iter()).map(|view| View::new(view.camera, &view.image.to_bytes(), None)).collect()
}

fn sfm(criterion: &mut Criterion) {
    let views = views(8);
    let features = |i: usize| Features::new(&views[i].gray, SIZE, None, 3000);
    let (first, second) = (features(0), features(1));
    criterion.bench_function("features, 384 x 288", |b| b.iter(|| black_box(features(0))));
    let name = format!("matches, {} and {} keypoints", first.keypoints.len(), second.keypoints.len());
    criterion.bench_function(&name, |b| b.iter(|| black_box(matches(&first, &second))));
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

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    sfm(&mut criterion);
    criterion.final_summary();
}
