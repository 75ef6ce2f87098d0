//! Conversion between OpenGL (NeRF) camera-to-world poses and the OpenCV world-to-camera poses used everywhere else.
//!
//! OpenGL cameras look along -z with y up; OpenCV cameras look along +z with y down. The two differ by half a turn
//! about the camera's x axis, `F = diag(1, -1, -1)`, applied in camera coordinates. World coordinates do not change.

use crate::Pose;
use glam::{DMat3, DVec3};

const FLIP: DMat3 = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));

/// The OpenCV world-to-camera pose of an OpenGL camera-to-world transform: `(c2w F)^-1`.
///
/// ```
/// use weaver_geometry::{Pose, axes, glam::DVec3};
/// // The identity in OpenGL looks along -z of the world.
/// let pose = axes::from_opengl(&Pose::IDENTITY);
/// assert_eq!(pose.apply(DVec3::new(0.0, 0.0, -2.0)).z, 2.0);
/// ```
pub fn from_opengl(camera_to_world: &Pose) -> Pose {
    Pose::new(camera_to_world.rotation * FLIP, camera_to_world.translation).inverse()
}

/// The OpenGL camera-to-world transform of an OpenCV world-to-camera pose; the inverse of [`from_opengl`].
pub fn to_opengl(pose: &Pose) -> Pose {
    let camera_to_world = pose.inverse();
    Pose::new(camera_to_world.rotation * FLIP, camera_to_world.translation)
}
