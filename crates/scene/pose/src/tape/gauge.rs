//! Poses relative to the first camera.

use super::code::LENGTH;
use super::rotation::{product, unit, with_positive_w};
use super::row_map::{RowMap, RowMapOp};
use crate::rotation::matrix;
use weaver_autograd::{Dual, Real, Var};

#[derive(Debug)]
struct RelativeCode;

impl RowMap<18, 9> for RelativeCode {
    const NAME: &'static str = "relative_pose_code";
    const INPUTS: &'static [&'static [usize]] = &[&[LENGTH], &[LENGTH]];
    const OUTPUTS: &'static [&'static [usize]] = &[&[LENGTH]];
    fn eval<T: Real>(&self, codes: [Dual<T, 18>; 18]) -> [Dual<T, 18>; 9] {
        let code = &codes[..LENGTH];
        let first = &codes[LENGTH..];
        let conjugate = [-first[3], -first[4], -first[5], first[6]];
        // Normalized after the product, not before: the first camera's own quotient is then (0, 0, 0, 1) to the bit.
        let q = unit(product([code[3], code[4], code[5], code[6]], conjugate));
        let r = matrix(q);
        let turned = |i: usize| r[3 * i] * first[0] + r[3 * i + 1] * first[1] + r[3 * i + 2] * first[2];
        let q = with_positive_w(q);
        [code[0] - turned(0), code[1] - turned(1), code[2] - turned(2), q[0], q[1], q[2], q[3], code[7], code[8]]
    }
}

/// Expresses pose codes in the frame of each scene's first camera: pose i becomes E_i E_0^-1.
///
/// q = q_i q_0* (unit, w not negative) and T = T_i - R(q) T_0; fields of view are unchanged. Camera 0 becomes exactly
/// the identity. `code` `[B, V, 9]`, with quaternions of any length but 0, gives `[B, V, 9]`. Differentiable in all
/// codes. A network whose poses pass through this function may choose its own world frame, which makes poses learnable
/// from random weights.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f32>::new();
/// let first = [0.3, -1.0, 2.0, 0.1, 0.2, -0.3, 0.8, 1.0, 1.2];
/// let code = weaver_pose::first_camera_gauge(tape.leaf(&first, [1, 1, 9]));
/// assert_eq!(code.to_vec(), [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.2]);
/// ```
#[track_caller]
pub fn first_camera_gauge<T: Real>(code: Var<'_, T>) -> Var<'_, T> {
    let fits = code.shape().rank() == 3 && code.shape()[2] == 9;
    code.tape().ensure_shapes(fits, "first_camera_gauge", "pose codes [B, V, 9]", &[code.shape()]);
    let first = code.slice(1, 0, 1).expand(code.shape());
    let [relative] = code.tape().apply(RowMapOp(RelativeCode), &[code, first]);
    relative
}
