//! Rigid world-to-camera transforms.

use glam::{DMat3, DQuat, DVec3};

/// A rigid world-to-camera transform: `x_camera = rotation * x_world + translation`.
///
/// OpenCV axes: x right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Rotation from world to camera axes.
    pub rotation: DMat3,
    /// Position of the world's origin in camera coordinates.
    pub translation: DVec3,
}

impl Default for Pose {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Pose {
    /// The camera at the origin of the world.
    pub const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// From a rotation matrix and a translation.
    pub fn new(rotation: DMat3, translation: DVec3) -> Self {
        Self { rotation, translation }
    }

    /// From a quaternion in wxyz order (normalised here) and a translation.
    pub fn from_wxyz(q: [f64; 4], translation: DVec3) -> Self {
        let q = DQuat::from_xyzw(q[1], q[2], q[3], q[0]).normalize();
        Self { rotation: DMat3::from_quat(q), translation }
    }

    /// The rotation as a unit quaternion in wxyz order, w not negative.
    pub fn wxyz(&self) -> [f64; 4] {
        let q = DQuat::from_mat3(&self.rotation);
        let q = if q.w < 0.0 { -q } else { q };
        [q.w, q.x, q.y, q.z]
    }

    /// The inverse, camera-to-world.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// `self` after `first`: `x -> self(first(x))`.
    pub fn compose(&self, first: &Self) -> Self {
        Self {
            rotation: self.rotation * first.rotation,
            translation: self.rotation * first.translation + self.translation,
        }
    }

    /// This camera seen from `reference`'s frame: `self * reference^-1`, the identity for itself.
    pub fn relative_to(&self, reference: &Self) -> Self {
        self.compose(&reference.inverse())
    }

    /// Maps a world point into the camera.
    pub fn apply(&self, world: DVec3) -> DVec3 {
        self.rotation * world + self.translation
    }

    /// The camera's centre in world coordinates, `-R^T t`.
    pub fn centre(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// The same camera in a world whose lengths are multiplied by `factor`.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { translation: self.translation * factor, ..*self }
    }

    /// Angle of the rotation between two cameras, in radians.
    pub fn angle_to(&self, other: &Self) -> f64 {
        let trace = (self.rotation * other.rotation.transpose()).to_cols_array_2d();
        ((trace[0][0] + trace[1][1] + trace[2][2] - 1.0) / 2.0).clamp(-1.0, 1.0).acos()
    }
}
