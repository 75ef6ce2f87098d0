//! Paths of a camera along those of a capture.

use crate::Frame;
use weaver_geometry::glam::{DMat3, DQuat, DVec3};
use weaver_geometry::{Camera, Pose, trajectory};

/// A path of a camera along those of a capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraPath {
    /// Around the point that the cameras look at, as far away and as high as they are.
    Ellipse,
    /// Through the cameras in their order, smoothed.
    Spline,
    /// From behind the middle camera toward the point that it looks at, and back.
    Dolly,
}

/// Standard deviation of the smoothing of a spline, in cameras.
const SMOOTH: f64 = 1.5;
/// The part of the cameras that an ellipse is as far away as.
const RADIUS: f64 = 0.75;
/// Parts of the distance to the target that a dolly goes backward and forward.
const DOLLY: [f64; 2] = [0.25, 0.35];

impl CameraPath {
    /// `count` cameras of the path, with the lens of the first camera. `middle` is a point of the scene to look at
    /// where cameras do not agree on one. No cameras where none are given.
    pub fn along(self, cameras: &[Frame], count: usize, middle: DVec3) -> Vec<Frame> {
        let Some(first) = cameras.first() else { return Vec::new() };
        let poses: Vec<Pose> = cameras.iter().map(|frame| frame.camera.pose).collect();
        let target = looked_at(&poses).unwrap_or(middle);
        let poses = match self {
            Self::Ellipse => ellipse(&poses, target, count),
            Self::Spline => spline(&poses, count),
            Self::Dolly => dolly(&poses, target, count),
        };
        let named = |(i, pose)| Frame::new(format!("{i:04}"), Camera { pose, ..first.camera });
        poses.into_iter().enumerate().map(named).collect()
    }
}

/// The point nearest to all optical axes, if it lies before most cameras.
fn looked_at(poses: &[Pose]) -> Option<DVec3> {
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for pose in poses {
        let axis = forward(pose);
        // The projection onto the plane across the axis.
        let across = DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        matrix += across;
        right += across * pose.center();
    }
    // Axes that are nearly parallel have no point that is worth the name.
    if matrix.determinant() < 1e-4 * (poses.len() as f64).powi(3) {
        return None;
    }
    let point = matrix.inverse() * right;
    let before = poses.iter().filter(|pose| pose.apply(point).z > 0.0).count();
    (2 * before > poses.len()).then_some(point)
}

fn forward(pose: &Pose) -> DVec3 {
    pose.rotation.row(2)
}

/// The mean of the upward directions of images.
fn up(poses: &[Pose]) -> DVec3 {
    let sum: DVec3 = poses.iter().map(|pose| -pose.rotation.row(1)).sum();
    sum.try_normalize().unwrap_or(DVec3::NEG_Y)
}

fn ellipse(poses: &[Pose], target: DVec3, count: usize) -> Vec<Pose> {
    let up = up(poses);
    let height = poses.iter().map(|pose| (pose.center() - target).dot(up)).sum::<f64>() / poses.len() as f64;
    // The longer axis is where centers spread most within the plane.
    let start = poses[0].center() - target;
    let x = (start - up * start.dot(up)).try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
    let y = up.cross(x);
    let reach = |axis: DVec3| {
        let mut all: Vec<f64> = poses.iter().map(|pose| (pose.center() - target).dot(axis).abs()).collect();
        all.sort_unstable_by(f64::total_cmp);
        all[((all.len() - 1) as f64 * RADIUS).round() as usize]
    };
    let (a, b) = (reach(x), reach(y));
    // A capture from one side has hardly any extent across it: a circle is then better than a line.
    let (a, b) = (a.max(0.4 * b).max(1e-3), b.max(0.4 * a).max(1e-3));
    let camera = |i: usize| {
        let (sin, cos) = (std::f64::consts::TAU * i as f64 / count as f64).sin_cos();
        trajectory::look_at(target + height * up + a * cos * x + b * sin * y, target, up)
    };
    (0..count).map(camera).collect()
}

/// Means of neighbors by a Gaussian window: centers linearly, rotations as quaternions of one sign.
fn spline(poses: &[Pose], count: usize) -> Vec<Pose> {
    let quats: Vec<DQuat> = poses.iter().map(|pose| DQuat::from_mat3(&pose.rotation)).collect();
    let last = (poses.len() - 1) as f64;
    let camera = |i: usize| {
        let at = last * i as f64 / (count.max(2) - 1) as f64;
        let nearest = quats[at.round() as usize];
        let (mut center, mut quat, mut total) = (DVec3::ZERO, DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), 0.0);
        for (k, (pose, other)) in poses.iter().zip(&quats).enumerate() {
            let weight = (-0.5 * ((k as f64 - at) / SMOOTH).powi(2)).exp();
            let sign = if other.dot(nearest) < 0.0 { -weight } else { weight };
            (center, quat, total) = (center + weight * pose.center(), quat + *other * sign, total + weight);
        }
        let rotation = DMat3::from_quat(quat.normalize());
        Pose::new(rotation, -(rotation * (center / total)))
    };
    (0..count).map(camera).collect()
}

fn dolly(poses: &[Pose], target: DVec3, count: usize) -> Vec<Pose> {
    let from = poses[poses.len() / 2];
    let distance = from.apply(target).z.abs().max(1e-3);
    let [backward, onward] = DOLLY;
    let camera = |i: usize| {
        let eased = 0.5 - 0.5 * (std::f64::consts::TAU * i as f64 / count as f64).cos();
        let center = from.center() + forward(&from) * distance * (eased * (backward + onward) - backward);
        Pose::new(from.rotation, -(from.rotation * center))
    };
    (0..count).map(camera).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::Intrinsics;

    /// Cameras on a part of a circle of radius 3 around a point, slightly above it.
    fn ring(count: usize, turn: f64) -> (Vec<Frame>, DVec3) {
        let target = DVec3::new(1.0, 2.0, 3.0);
        let intrinsics = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0 };
        let frame = |i: usize| {
            let (sin, cos) = (turn * i as f64 / count as f64).sin_cos();
            let pose = trajectory::look_at(target + DVec3::new(3.0 * sin, -0.5, -3.0 * cos), target, DVec3::NEG_Y);
            Frame::new(i.to_string(), Camera { pose, intrinsics, width: 64, height: 48 })
        };
        ((0..count).map(frame).collect(), target)
    }

    /// An ellipse looks at what cameras look at from as far away.
    #[test]
    fn an_ellipse_looks_where_cameras_look() {
        let (frames, target) = ring(40, std::f64::consts::TAU);
        for frame in CameraPath::Ellipse.along(&frames, 30, DVec3::ZERO) {
            let seen = frame.camera.pose.apply(target);
            assert!(seen.x.abs() < 1e-9 && seen.y.abs() < 1e-9, "{seen}");
            assert!((2.0..3.6).contains(&seen.z), "{seen}");
        }
    }

    /// A spline stays near the cameras and moves in small steps.
    #[test]
    fn a_spline_stays_near_the_cameras() {
        let (frames, target) = ring(20, 2.0);
        let path = CameraPath::Spline.along(&frames, 100, DVec3::ZERO);
        assert_eq!(path.len(), 100);
        let centers: Vec<DVec3> = path.iter().map(|frame| frame.camera.pose.center()).collect();
        assert!(centers.windows(2).all(|two| two[0].distance(two[1]) < 0.12));
        assert!(centers.iter().all(|center| (2.7..3.3).contains(&center.distance(target))));
        // Quaternions of opposite signs are the same rotation.
        assert!(path.iter().all(|frame| frame.camera.pose.rotation.determinant() > 0.999));
    }

    #[test]
    fn a_dolly_goes_straight_and_comes_back() {
        let (frames, target) = ring(9, 1.0);
        let path = CameraPath::Dolly.along(&frames, 40, DVec3::ZERO);
        let depth = |i: usize| path[i].camera.pose.apply(target).z;
        assert!(depth(0) > depth(10) && depth(10) > depth(20) && depth(20) < depth(30) && depth(20) > 0.5);
        assert!(path.iter().all(|frame| frame.camera.pose.rotation == path[0].camera.pose.rotation));
    }

    #[test]
    fn parallel_cameras_look_at_the_middle_of_the_scene() {
        let intrinsics = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0 };
        let frame = |i: usize| {
            let pose = Pose::new(DMat3::IDENTITY, DVec3::new(-0.1 * i as f64, 0.0, 0.0));
            Frame::new(i.to_string(), Camera { pose, intrinsics, width: 64, height: 48 })
        };
        let frames: Vec<Frame> = (0..5).map(frame).collect();
        let path = CameraPath::Ellipse.along(&frames, 8, DVec3::new(0.2, 0.0, 4.0));
        assert!(path.iter().all(|frame| frame.camera.pose.apply(DVec3::new(0.2, 0.0, 4.0)).x.abs() < 1e-9));
        assert!(CameraPath::Spline.along(&frames[..1], 3, DVec3::ZERO).len() == 3);
        assert!(CameraPath::Ellipse.along(&[], 3, DVec3::ZERO).is_empty());
    }
}
