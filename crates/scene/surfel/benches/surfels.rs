//! Drawing and differentiating a room of surfels at 64 x 1024.

#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use weaver_geometry::Pose;
use weaver_geometry::glam::{DQuat, DVec3};
use weaver_kernels::random::Stream;
use weaver_surfel::{Limits, RangeCotangents, RangeImages, Sight, SurfelCamera, SurfelWorkspace, Surfels};

fn room(n: usize) -> Surfels<f32> {
    let stream = Stream::new(0, 0, "room");
    let mut surfels = Surfels::default();
    for i in 0..n as u64 {
        let [az, el, depth] = [0, 1, 2].map(|k| stream.uniform::<f64>(4 * i + k));
        let (az, el) = (az * std::f64::consts::TAU, (el - 0.5) * 0.6);
        let away = DVec3::new(az.cos() * el.cos(), az.sin() * el.cos(), el.sin());
        let q = DQuat::from_rotation_arc(DVec3::Z, -away);
        let center = (away * (5.0 + 15.0 * depth)).to_array().map(|x| x as f32);
        surfels.push(center, [q.w, q.x, q.y, q.z].map(|x| x as f32), [-2.0; 2], 2.0);
    }
    surfels
}

fn surfels(c: &mut Criterion) {
    let (surfels, camera, poses) = (room(20_000), SurfelCamera::spherical([1024, 64], [-0.3, 0.3]), [Pose::IDENTITY]);
    let sight = Sight { surfels: surfels.slices(), camera: &camera, poses: &poses, limits: Limits::default() };
    let (mut workspace, mut images) = (SurfelWorkspace::new(), RangeImages::default());
    c.bench_function("draw 20k at 64x1024", |b| b.iter(|| workspace.draw(&sight, &mut images)));
    let mut gradients = Surfels::default();
    c.bench_function("draw and differentiate", |b| {
        b.iter(|| {
            workspace.draw(&sight, &mut images).unwrap();
            let range = Some(&images.opacity[..]);
            let cotangents = RangeCotangents { range, opacity: range, normal: Some(&images.normal) };
            workspace.backward(&sight, &cotangents, &mut gradients, None);
        });
    });
}

criterion_group!(benches, surfels);
criterion_main!(benches);
