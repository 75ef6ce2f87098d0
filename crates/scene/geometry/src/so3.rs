//! The exponential map of SO(3): rotations and their logarithms, the rotation vectors (axis times angle in radians).

use glam::{DMat3, DQuat, DVec3};

/// The rotation by `|omega|` about `omega`, the matrix exponential of [`hat`]`(omega)`.
pub fn exp(omega: DVec3) -> DMat3 {
    let half = omega.length() / 2.0;
    // sin(h) / 2h; its next term, h^4 / 240, is below the last bit.
    let s = if half < 1e-4 { 0.5 - half * half / 12.0 } else { half.sin() / (2.0 * half) };
    let v = omega * s;
    DMat3::from_quat(DQuat::from_xyzw(v.x, v.y, v.z, half.cos()).normalize())
}

/// The rotation vector of a rotation, of length at most pi; the inverse of [`exp`].
///
/// Accurate at every angle, because it is computed from the quaternion, whose vector part is small only near the
/// identity.
pub fn log(rotation: &DMat3) -> DVec3 {
    let q = DQuat::from_mat3(rotation);
    let q = if q.w < 0.0 { -q } else { q };
    let v = DVec3::new(q.x, q.y, q.z);
    let sin = v.length();
    // 2 atan(s / w) / s where s is so small that s / w is its arc tangent.
    let factor = if sin < 1e-9 { 2.0 / q.w } else { 2.0 * sin.atan2(q.w) / sin };
    v * factor
}

/// The matrix of the cross product: `hat(a) b = a x b`.
pub fn hat(a: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, a.z, -a.y), DVec3::new(-a.z, 0.0, a.x), DVec3::new(a.y, -a.x, 0.0))
}
