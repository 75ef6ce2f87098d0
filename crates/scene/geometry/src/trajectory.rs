//! Camera paths to render along.

use crate::Pose;
use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::TAU;

/// The camera at `eye` that looks at `target`, with `up` pointing up in its image.
///
/// When `up` is parallel to the view, the roll is arbitrary. `eye` and `target` must differ.
///
/// ```
/// use weaver_geometry::{glam::DVec3, trajectory::look_at};
/// let pose = look_at(DVec3::new(0.0, 0.0, -3.0), DVec3::ZERO, DVec3::Y);
/// assert!((pose.apply(DVec3::ZERO) - DVec3::new(0.0, 0.0, 3.0)).length() < 1e-12);
/// assert!(pose.apply(DVec3::Y).y < 0.0); // y of the camera points down
/// ```
pub fn look_at(eye: DVec3, target: DVec3, up: DVec3) -> Pose {
    let forward = (target - eye).normalize();
    let right = forward.cross(up).try_normalize().unwrap_or_else(|| forward.any_orthonormal_vector());
    let down = forward.cross(right);
    let rotation = DMat3::from_cols(right, down, forward).transpose();
    Pose::new(rotation, -(rotation * eye))
}

/// An orbit of `count` cameras, evenly spaced over one turn and starting at `eye`, all looking at `target`.
///
/// They lie on the circle through `eye` about the axis `up` through `target`.
pub fn orbit(eye: DVec3, target: DVec3, up: DVec3, count: usize) -> Vec<Pose> {
    let camera = |i: usize| {
        let turn = DQuat::from_axis_angle(up.normalize(), TAU * i as f64 / count as f64);
        look_at(target + turn * (eye - target), target, up)
    };
    (0..count).map(camera).collect()
}

/// The camera between `a` (`t` = 0) and `b` (`t` = 1): its center is interpolated linearly, its rotation spherically
/// along the shorter turn.
pub fn between(a: &Pose, b: &Pose, t: f64) -> Pose {
    let quat = |p: &Pose| DQuat::from_mat3(&p.rotation);
    let rotation = DMat3::from_quat(quat(a).slerp(quat(b), t).normalize());
    Pose::new(rotation, -(rotation * a.center().lerp(b.center(), t)))
}

/// A path through all `keys` in their order, with `steps` cameras from each key up to the next, and the last key.
///
/// # Panics
/// When `steps` is 0.
pub fn through(keys: &[Pose], steps: usize) -> Vec<Pose> {
    assert!(steps > 0, "at least one step between keys");
    let segment = |pair: &[Pose]| {
        let (a, b) = (pair[0], pair[1]);
        (0..steps).map(move |i| between(&a, &b, i as f64 / steps as f64))
    };
    keys.windows(2).flat_map(segment).chain(keys.last().copied()).collect()
}

/// The point that is nearest to the optical axes of all cameras, by least squares; none where all look the same way.
///
/// (sum of I - a a^T) x = sum of (I - a a^T) c, for the axes a and the centers c.
///
/// ```
/// use weaver_geometry::{glam::DVec3, trajectory::{focus, orbit}};
/// let cameras = orbit(DVec3::new(3.0, 0.0, 1.0), DVec3::new(1.0, 0.0, 0.0), DVec3::Z, 5);
/// assert!(focus(&cameras).unwrap().distance(DVec3::X) < 1e-12);
/// assert_eq!(focus(&cameras[..1]), None);
/// ```
pub fn focus(cameras: &[Pose]) -> Option<DVec3> {
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for camera in cameras {
        let axis = camera.rotation.transpose() * DVec3::Z;
        let across = DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        matrix += across;
        right += across * camera.center();
    }
    (matrix.determinant().abs() > 1e-9).then(|| matrix.inverse() * right)
}
