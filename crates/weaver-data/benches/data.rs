//! Procedural scenes at the smallest training size, and a tuple drawn from it.

use criterion::Criterion;
use weaver_data::procedural::{ProceduralOptions, scene, varied_scene};
use weaver_data::training_tuple;
use weaver_kernels::random::Stream;

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("data");
    let options = ProceduralOptions { width: 64, height: 48, views: 24 };
    group.sample_size(10);
    group.bench_function("procedural scene 24 x 64x48", |b| b.iter(|| scene(1, &options)));
    let fresh = ProceduralOptions { views: 8, ..options };
    let mut seed = 0;
    group.bench_function("varied procedural scene 8 x 64x48", |b| {
        b.iter(|| {
            seed += 1;
            varied_scene(seed, &fresh)
        });
    });

    let scenes = [scene(1, &options)];
    let rng = Stream::new(1, 0, "bench");
    group.bench_function("training tuple of 24 views", |b| {
        b.iter(|| {
            let tuple = training_tuple(&scenes, rng, 3, 6, 4, 2);
            scenes[0].normalized(&tuple).expect("a scene with points")
        });
    });
    group.finish();
    criterion.final_summary();
}
