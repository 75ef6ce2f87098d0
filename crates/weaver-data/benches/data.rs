//! One procedural scene of 24 views at the smallest training size.

use criterion::{Criterion, criterion_group, criterion_main};
use weaver_data::procedural::{ProceduralOptions, scene};

fn procedural(c: &mut Criterion) {
    let options = ProceduralOptions { width: 64, height: 48, views: 24 };
    let mut group = c.benchmark_group("procedural");
    group.sample_size(10);
    group.bench_function("scene 24 x 64x48", |b| b.iter(|| scene(1, &options)));
    group.finish();
}

criterion_group! {
    /// Data benches.
    benches, procedural
}
criterion_main!(benches);
