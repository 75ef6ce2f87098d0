//! Sweeps of a lidar.

use weaver_geometry::Pose;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_procedural::lidar::{LidarWorld, SpinningSensor, between, room_loop, street_drive};

fn vector(p: &[f32; 3]) -> DVec3 {
    DVec3::from_array(p.map(f64::from))
}

/// The distance of a point from triangles.
fn distance((vertices, triangles): &(Vec<[f32; 3]>, Vec<[u32; 3]>), p: DVec3) -> f64 {
    let to = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| vector(&vertices[i as usize]));
        let n = (b - a).cross(c - a).normalize();
        let q = p - n * n.dot(p - a);
        let inside = [(a, b), (b, c), (c, a)].iter().all(|(u, v)| (*v - *u).cross(q - *u).dot(n) >= 0.0);
        let edge = |u: DVec3, v: DVec3| {
            p.distance(u + (v - u) * ((p - u).dot(v - u) / (v - u).length_squared()).clamp(0.0, 1.0))
        };
        if inside { (p - a).dot(n).abs() } else { edge(a, b).min(edge(b, c)).min(edge(c, a)) }
    };
    triangles.iter().map(to).fold(f64::INFINITY, f64::min)
}

#[test]
fn points_are_on_the_mesh() {
    let sensor = SpinningSensor { rows: 16, columns: 60, noise: 0.0, divergence: 0.0, ..Default::default() };
    for (world, poses) in [(LidarWorld::room(), room_loop(7)), (LidarWorld::street(1), street_drive(5, 11.0))] {
        let mesh = world.mesh();
        for (i, pose) in poses.iter().enumerate() {
            let sweep = sensor.sweep(&world, |_| *pose, 3, i as u64);
            assert!(sweep.points.len() > 400, "{}", sweep.points.len());
            for p in sweep.points.iter().step_by(7) {
                let away = distance(&mesh, pose.apply(vector(p)));
                assert!(away < 2e-3, "{p:?}: {away}");
            }
        }
    }
}

#[test]
fn noise_is_as_large_as_it_says() {
    let (world, pose) = (LidarWorld::room(), room_loop(1)[0]);
    let sensor = SpinningSensor { divergence: 0.0, ..Default::default() };
    let [exact, noisy] =
        [0.0, 0.02].map(|noise| SpinningSensor { noise, ..sensor }.sweep(&world, |_| pose, 5, 0).points);
    let squares = exact.iter().zip(&noisy).map(|(a, b)| vector(a).distance_squared(vector(b)));
    let deviation = (squares.sum::<f64>() / exact.len() as f64).sqrt();
    assert!((deviation - 0.02).abs() < 1e-3, "{deviation}");
}

#[test]
fn motion_within_a_sweep_is_undone_by_the_times() {
    let (world, poses) = (LidarWorld::room(), room_loop(60));
    let sensor = SpinningSensor { noise: 0.0, divergence: 0.0, ..Default::default() };
    let motion = |t: f64| between(&poses[3], &poses[4], t);
    let sweep = sensor.sweep(&world, motion, 0, 3);
    let mesh = world.mesh();
    let away = |pose: &dyn Fn(f32) -> Pose| -> f64 {
        let points = sweep.points.iter().zip(&sweep.times).step_by(101);
        points.map(|(p, t)| distance(&mesh, pose(*t).apply(vector(p)))).fold(0.0, f64::max)
    };
    assert!(away(&|t| motion(t.into())) < 2e-3);
    assert!(away(&|_| poses[3]) > 0.05);
}

#[test]
fn the_same_seed_gives_the_same_sweep() {
    let (world, pose) = (LidarWorld::room(), Pose::new(DMat3::IDENTITY, DVec3::new(5.0, 4.0, 1.0)));
    let sweep = |seed| SpinningSensor::default().sweep(&world, |_| pose, seed, 1);
    assert_eq!(sweep(1), sweep(1));
    assert_ne!(sweep(1), sweep(2));
}
