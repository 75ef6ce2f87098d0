//! Pose codes: the nine numbers in which pose heads express a camera ("absT_quaR_FoV").
//!
//! `[tx, ty, tz, qx, qy, qz, qw, fov_vertical, fov_horizontal]`: the translation of the world-to-camera pose,
//! its rotation as a quaternion with the scalar *last* (everywhere else it comes first), and full fields of view in
//! radians. The principal point is the center of the image. Source: Wang et al., "VGGT" (CVPR 2025).

use crate::fov::focal_length;
use crate::{Camera, Intrinsics, Pose};
use glam::DVec3;

/// The offset that published weights expect on the tangent of half the field of view; it keeps focal lengths finite at
/// a field of view of 0.
pub const TANGENT_OFFSET: f64 = 1e-3;

/// The pose code of a camera, its quaternion of unit length with w not negative.
///
/// A code has no principal point: one off the center of the image is lost.
pub fn encode(camera: &Camera) -> [f64; 9] {
    let t = camera.pose.translation;
    let [w, x, y, z] = camera.pose.wxyz();
    let [vertical, horizontal] = camera.intrinsics.fov(camera.width, camera.height);
    [t.x, t.y, t.z, x, y, z, w, vertical, horizontal]
}

/// The camera of a pose code, for an image of `width` x `height` pixels.
///
/// The focal lengths are `f = (size / 2) / (tan(fov / 2) + tangent_offset)`.
///
/// The quaternion need not be of unit length. With `tangent_offset` 0 this inverts [`encode`]; see
/// [`TANGENT_OFFSET`]. A quaternion of zeros gives a rotation of NaN.
///
/// ```
/// use weaver_geometry::pose_code::{decode, encode};
/// let camera = decode([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 2.0, 1.0, 1.2], 64, 48, 0.0);
/// assert!((encode(&camera)[6] - 1.0).abs() < 1e-12);
/// assert!((encode(&camera)[8] - 1.2).abs() < 1e-12);
/// ```
pub fn decode(code: [f64; 9], width: usize, height: usize, tangent_offset: f64) -> Camera {
    let [tx, ty, tz, x, y, z, w, vertical, horizontal] = code;
    let focal = |size: usize, fov| focal_length(fov, size as f64, tangent_offset, f64::tan);
    let intrinsics = Intrinsics {
        fx: focal(width, horizontal),
        fy: focal(height, vertical),
        cx: width as f64 / 2.0,
        cy: height as f64 / 2.0,
    };
    Camera { pose: Pose::from_wxyz([w, x, y, z], DVec3::new(tx, ty, tz)), intrinsics, width, height }
}
