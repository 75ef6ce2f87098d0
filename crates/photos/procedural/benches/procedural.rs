//! Procedural scenes at the smallest training size.

use criterion::Criterion;
use weaver_procedural::{ProceduralOptions, scene, varied_scene};

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("procedural");
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
    group.finish();
    criterion.final_summary();
}
