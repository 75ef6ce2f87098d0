//! Random surfels around a camera.

use weaver_geometry::glam::{DQuat, DVec3};
use weaver_geometry::{Intrinsics, Pose, so3};
use weaver_kernels::Real;
use weaver_kernels::random::Stream;
use weaver_surfel::{Lens, Limits, RangeImages, Sight, SurfelCamera, SurfelWorkspace, Surfels};

/// The rotation that takes z to a direction, turned around it.
pub fn facing(normal: DVec3, turn: f64) -> DQuat {
    DQuat::from_rotation_arc(DVec3::Z, normal.normalize()) * DQuat::from_rotation_z(turn)
}

/// Surfels in all directions, a few of them tiny, nearly all facing the origin roughly.
pub fn shell<T: Real>(seed: u64, n: usize, size: f64) -> Surfels<T> {
    let stream = Stream::new(seed, 0, "shell");
    let normal = |n: usize, k: usize| stream.normal::<f64>((32 * n + k) as u64);
    let mut surfels = Surfels::default();
    for n in 0..n {
        let vector = |k: usize| DVec3::new(normal(n, k), normal(n, k + 1), normal(n, k + 2));
        let away = vector(0).normalize();
        let q = facing(-away + 0.4 * vector(3), normal(n, 6)) * (1.0 + 0.3 * normal(n, 7).abs());
        let center = away * (2.0 + normal(n, 8).abs());
        // A quarter is smaller than a pixel.
        let scale = if n % 4 == 0 { 0.003 } else { size };
        let log_scales = [10, 11].map(|k| T::from_f64(scale.ln() + 0.3 * normal(n, k)));
        let numbers = [q.w, q.x, q.y, q.z].map(T::from_f64);
        surfels.push(center.to_array().map(T::from_f64), numbers, log_scales, T::from_f64(1.5 * normal(n, 12)));
    }
    surfels
}

/// A spherical camera with (nearly) the poles, or a pinhole.
pub fn camera(spherical: bool, [width, height]: [usize; 2]) -> SurfelCamera {
    if spherical {
        return SurfelCamera::spherical([width, height], [-1.5, 1.55]);
    }
    let focal = 0.5 * width as f64;
    let lens = Intrinsics { fx: focal, fy: 1.1 * focal, cx: 0.52 * width as f64, cy: 0.5 * height as f64 };
    SurfelCamera { lens: Lens::Pinhole(lens), width, height }
}

pub fn poses(seed: u64, count: usize) -> Vec<Pose> {
    let stream = Stream::new(seed, 0, "poses");
    let vector = |i: u64| DVec3::from_array([0, 1, 2].map(|k| stream.normal::<f64>(8 * i + k)));
    let pose = |i: u64| Pose::new(so3::exp(vector(2 * i)), 0.2 * vector(2 * i + 1));
    (0..count as u64).map(pose).collect()
}

pub fn sight<'a, T: Real>(surfels: &'a Surfels<T>, camera: &'a SurfelCamera, poses: &'a [Pose]) -> Sight<'a, T> {
    Sight { surfels: surfels.slices(), camera, poses, limits: Limits::default() }
}

pub fn draw<T: Real>(sight: &Sight<'_, T>) -> (SurfelWorkspace<T>, RangeImages<T>) {
    let (mut workspace, mut images) = (SurfelWorkspace::new(), RangeImages::default());
    workspace.draw(sight, &mut images).unwrap();
    (workspace, images)
}
