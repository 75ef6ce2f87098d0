//! Quaternions (xyzw) and rotation matrices, as differentiable ops on rows.

use super::row_map::{RowMap, RowMapOp};
use crate::rotation::{Quaternion, matrix};
use weaver_autograd::{Dual, Real, Var};

/// The unit quaternion, w not negative, of a rotation matrix (row-major), by its largest component.
pub(crate) fn quaternion<T: Real, const N: usize>(m: [Dual<T, N>; 9]) -> Quaternion<T, N> {
    let (trace, [a, b, c]) = (m[0] + m[4] + m[8], [m[0], m[4], m[8]]);
    // Four times the square of each component, in the order w, x, y, z.
    let squares = [1 + trace, 1 + a - b - c, 1 - a + b - c, 1 - a - b + c];
    let mut largest = 0;
    for i in 1..4 {
        if squares[i].value > squares[largest].value {
            largest = i;
        }
    }
    let twice = squares[largest].sqrt();
    let over = 0.5 / twice;
    let half = 0.5 * twice;
    let (wx, wy, wz) = ((m[7] - m[5]) * over, (m[2] - m[6]) * over, (m[3] - m[1]) * over);
    let (xy, xz, yz) = ((m[3] + m[1]) * over, (m[2] + m[6]) * over, (m[5] + m[7]) * over);
    with_positive_w(match largest {
        0 => [wx, wy, wz, half],
        1 => [half, xy, xz, wx],
        2 => [xy, half, yz, wy],
        _ => [xz, yz, half, wz],
    })
}

/// The Hamilton product a b: the rotation b, then a.
pub(crate) fn product<T: Real, const N: usize>(a: Quaternion<T, N>, b: Quaternion<T, N>) -> Quaternion<T, N> {
    let ([ax, ay, az, aw], [bx, by, bz, bw]) = (a, b);
    // Grouped so that q q* cancels to the bit.
    [
        (aw * bx + ax * bw) + (ay * bz - az * by),
        (aw * by + ay * bw) + (az * bx - ax * bz),
        (aw * bz + az * bw) + (ax * by - ay * bx),
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

/// The quaternion divided by its length.
pub(crate) fn unit<T: Real, const N: usize>(q: Quaternion<T, N>) -> Quaternion<T, N> {
    let length = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    q.map(|c| c / length)
}

/// The sign of a quaternion chosen so that w is not negative.
pub(crate) fn with_positive_w<T: Real, const N: usize>(q: Quaternion<T, N>) -> Quaternion<T, N> {
    if q[3].value < T::ZERO { q.map(|c| -c) } else { q }
}

#[derive(Debug)]
struct RotationFromXyzw;

impl RowMap<4, 9> for RotationFromXyzw {
    const NAME: &'static str = "rotation_from_xyzw";
    const INPUTS: &'static [&'static [usize]] = &[&[4]];
    const OUTPUTS: &'static [&'static [usize]] = &[&[3, 3]];
    fn eval<T: Real>(&self, q: [Dual<T, 4>; 4]) -> [Dual<T, 4>; 9] {
        matrix(q)
    }
}

/// The rotation matrices of quaternions of any length but 0.
///
/// R = I + s (w K + K^2), where K is the matrix of the cross product with (x, y, z) and s = 2 / |q|^2. `q` `[.., 4]` in
/// xyzw order gives R `[.., 3, 3]`. Differentiable in `q`.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let quarter_turn_about_z = tape.leaf(&[0.0, 0.0, 1.0, 1.0], [4]);
/// let rotation = weaver_pose::rotation_from_xyzw(quarter_turn_about_z);
/// assert_eq!(rotation.to_vec(), [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
/// ```
#[track_caller]
pub fn rotation_from_xyzw<T: Real>(q: Var<'_, T>) -> Var<'_, T> {
    let [rotation] = q.tape().apply(RowMapOp(RotationFromXyzw), &[q]);
    rotation
}

#[derive(Debug)]
struct XyzwFromRotation;

impl RowMap<9, 4> for XyzwFromRotation {
    const NAME: &'static str = "xyzw_from_rotation";
    const INPUTS: &'static [&'static [usize]] = &[&[3, 3]];
    const OUTPUTS: &'static [&'static [usize]] = &[&[4]];
    fn eval<T: Real>(&self, m: [Dual<T, 9>; 9]) -> [Dual<T, 9>; 4] {
        quaternion(m)
    }
}

/// The unit quaternions of rotation matrices, with w not negative.
///
/// The largest component is half the square root of 1 plus or minus the diagonal entries; the others are sums and
/// differences of off-diagonal entries divided by it. `rotation` `[.., 3, 3]` gives `[.., 4]` in xyzw order.
/// Differentiable in the nine entries, taken as independent; the gradient is that of the component chosen.
#[track_caller]
pub fn xyzw_from_rotation<T: Real>(rotation: Var<'_, T>) -> Var<'_, T> {
    let [q] = rotation.tape().apply(RowMapOp(XyzwFromRotation), &[rotation]);
    q
}

#[derive(Debug)]
struct QuaternionProduct;

impl RowMap<8, 4> for QuaternionProduct {
    const NAME: &'static str = "quaternion_product";
    const INPUTS: &'static [&'static [usize]] = &[&[4], &[4]];
    const OUTPUTS: &'static [&'static [usize]] = &[&[4]];
    fn eval<T: Real>(&self, [a, b, c, d, e, f, g, h]: [Dual<T, 8>; 8]) -> [Dual<T, 8>; 4] {
        product([a, b, c, d], [e, f, g, h])
    }
}

/// The Hamilton product of quaternions in xyzw order, which rotates by `b` first and then by `a`.
///
/// `a` and `b` `[.., 4]` give `[.., 4]`; differentiable in both.
#[track_caller]
pub fn quaternion_product<'t, T: Real>(a: Var<'t, T>, b: Var<'t, T>) -> Var<'t, T> {
    let [q] = a.tape().apply(RowMapOp(QuaternionProduct), &[a, b]);
    q
}
