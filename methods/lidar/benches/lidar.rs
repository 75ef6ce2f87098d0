//! A keyframe of 200 steps, and the registration of a scan, in a hall at 64 x 1024.

#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use weaver_geometry::Pose;
use weaver_lidar::{Frame, MapSettings, Mapper, PatchTree, Scan, SurfelCamera, register};

/// A hall of 40 x 20 x 8 m.
fn scan() -> Scan {
    let point = |i: usize| {
        let (az, el) = ((i % 1024) as f64 * 0.006136, (i / 1024) as f64 * 0.009 - 0.28);
        let d = [az.cos() * el.cos(), az.sin() * el.cos(), el.sin()];
        let to = |d: f64, half: f64| (half / d).abs();
        let r = to(d[0], 20.0).min(to(d[1], 10.0)).min(to(d[2], 2.0));
        d.map(|d| (r * d) as f32)
    };
    Scan::new((0..64 * 1024).map(point).collect())
}

fn lidar(c: &mut Criterion) {
    let (scan, camera) = (scan(), SurfelCamera::spherical([1024, 64], [-0.3, 0.3]));
    let frame = Frame::new(&scan, &camera, "hall").unwrap().with_normals();
    let mut group = c.benchmark_group("lidar");
    group.sample_size(10);
    group.bench_function("keyframe of 200 steps", |b| {
        b.iter(|| {
            let mut mapper = Mapper::new(&camera, MapSettings::default()).unwrap();
            mapper.add(0, frame.clone(), Pose::IDENTITY).unwrap()
        });
    });
    let tree = PatchTree::new(&frame.points);
    group.bench_function("tree of patches", |b| b.iter(|| PatchTree::new(&frame.points)));
    group.bench_function("geometric stage", |b| {
        b.iter(|| register(&frame.points, &tree, &Pose::IDENTITY, &Default::default()));
    });
    group.finish();
}

criterion_group!(benches, lidar);
criterion_main!(benches);
