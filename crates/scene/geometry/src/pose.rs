//! Rigid world-to-camera transforms.

use glam::{DMat3, DQuat, DVec3};
use std::fmt;

/// A rigid world-to-camera transform: `x_camera = rotation * x_world + translation`.
///
/// OpenCV axes: x right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Pose {
    /// Rotation from world to camera axes.
    pub rotation: DMat3,
    /// The world's origin in camera coordinates.
    pub translation: DVec3,
}

impl Default for Pose {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Pose {
    /// The camera at the world's origin with its axes along the world's.
    pub const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// A pose from a rotation matrix and a translation.
    pub fn new(rotation: DMat3, translation: DVec3) -> Self {
        Self { rotation, translation }
    }

    /// The pose with the world and the camera's own axes mirrored at their planes x = 0: `M R M` and `M t`, M =
    /// diag(-1, 1, 1).
    #[must_use]
    pub fn mirrored(&self) -> Self {
        let mirror = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
        Self { rotation: mirror * self.rotation * mirror, translation: mirror * self.translation }
    }

    /// A pose from a quaternion in wxyz order, which is normalized, and a translation.
    pub fn from_wxyz(q: [f64; 4], translation: DVec3) -> Self {
        let q = DQuat::from_xyzw(q[1], q[2], q[3], q[0]).normalize();
        Self { rotation: DMat3::from_quat(q), translation }
    }

    /// A pose from the upper three rows of a 4x4 rigid transform, as files hold them.
    ///
    /// The rotation is made orthonormal, which removes the rounding of the file.
    ///
    /// # Errors
    /// When a value is not finite, an entry of `|R^T R - 1|` exceeds 1e-3, or the matrix is a reflection.
    pub fn from_rows(rows: &[[f64; 4]; 3]) -> Result<Self, NotRigid> {
        if rows.iter().flatten().any(|x| !x.is_finite()) {
            return Err(NotRigid::NotFinite);
        }
        let [a, b, c] = rows.map(|r| DVec3::new(r[0], r[1], r[2]));
        let rotation = DMat3::from_cols(a, b, c).transpose();
        let gram = rotation.transpose() * rotation - DMat3::IDENTITY;
        let deviation = gram.to_cols_array().iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        // Not `deviation > 1e-3`: products of huge finite entries may be NaN, which must not pass.
        if !matches!(deviation.partial_cmp(&1e-3), Some(std::cmp::Ordering::Less)) || gram.is_nan() {
            return Err(NotRigid::Deviation(deviation));
        }
        if rotation.determinant() < 0.0 {
            return Err(NotRigid::Mirror);
        }
        let q = DQuat::from_mat3(&rotation).normalize();
        let translation = DVec3::new(rows[0][3], rows[1][3], rows[2][3]);
        Ok(Self { rotation: DMat3::from_quat(q), translation })
    }

    /// The upper three rows of the 4x4 matrix `[R | t]`.
    pub fn rows(&self) -> [[f64; 4]; 3] {
        let r = self.rotation.transpose();
        let row = |axis: DVec3, t: f64| [axis.x, axis.y, axis.z, t];
        let t = self.translation;
        [row(r.x_axis, t.x), row(r.y_axis, t.y), row(r.z_axis, t.z)]
    }

    /// The rotation as a unit quaternion in wxyz order, w not negative.
    pub fn wxyz(&self) -> [f64; 4] {
        let q = DQuat::from_mat3(&self.rotation);
        let q = if q.w < 0.0 { -q } else { q };
        [q.w, q.x, q.y, q.z]
    }

    /// The inverse transform, camera to world.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// The composition `self` after `first`: `x -> self(first(x))`.
    pub fn compose(&self, first: &Self) -> Self {
        Self {
            rotation: self.rotation * first.rotation,
            translation: self.rotation * first.translation + self.translation,
        }
    }

    /// The pose of this camera in the frame of another: `self * reference^-1`, which is the identity for `reference`
    /// itself.
    pub fn relative_to(&self, reference: &Self) -> Self {
        self.compose(&reference.inverse())
    }

    /// Maps a world point to camera coordinates.
    pub fn apply(&self, world: DVec3) -> DVec3 {
        self.rotation * world + self.translation
    }

    /// The camera's center in world coordinates, `-R^T t`.
    pub fn center(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// The camera after all lengths of the world are multiplied by `factor`.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { translation: self.translation * factor, ..*self }
    }

    /// The angle of the rotation between two cameras, in radians.
    pub fn angle_to(&self, other: &Self) -> f64 {
        let trace = (self.rotation * other.rotation.transpose()).to_cols_array_2d();
        ((trace[0][0] + trace[1][1] + trace[2][2] - 1.0) / 2.0).clamp(-1.0, 1.0).acos()
    }
}

/// Why a matrix is not a rigid transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NotRigid {
    /// A value is infinite or NaN.
    NotFinite,
    /// The 3x3 part is not orthonormal; holds the largest entry of `|R^T R - 1|`.
    Deviation(f64),
    /// The determinant is -1: a reflection.
    Mirror,
}

impl fmt::Display for NotRigid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite => write!(f, "a value that is not finite"),
            Self::Deviation(d) => write!(f, "a matrix that is not a rotation (R^T R differs from 1 by {d:.3e})"),
            Self::Mirror => write!(f, "a reflection (determinant -1)"),
        }
    }
}

impl std::error::Error for NotRigid {}
