//! Depth of four photos of a planted wall.

#![allow(missing_docs)]

#[path = "../tests/it/planted.rs"]
mod planted;

use criterion::{Criterion, criterion_group, criterion_main};
use weaver_stereo::{Stereo, StereoSettings};

fn stereo(c: &mut Criterion) {
    let planted::Planted { photos, points, visible } = planted::wall(4);
    let settings = StereoSettings::default();
    let mut group = c.benchmark_group("stereo");
    group.sample_size(10);
    group.bench_function("four photos of 96 x 72", |b| b.iter(|| Stereo::of(&photos, &points, &visible, &settings)));
    let stereo = Stereo::of(&photos, &points, &visible, &settings);
    group.bench_function("surface and 500 Gaussians", |b| b.iter(|| stereo.surface().gaussians(500)));
    group.finish();
}

criterion_group!(benches, stereo);
criterion_main!(benches);
