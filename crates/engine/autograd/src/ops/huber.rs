//! The Huber loss, elementwise.

use crate::{Var, apply_pointwise, pointwise};
use weaver_kernels::Real;

pointwise!(
    /// Half the squared difference up to `delta`, and linear with the same slope beyond it.
    pub Huber { delta: f64 }, 2, |x, y| {
        let d = (x - y).abs();
        if d.value.to_f64() <= delta { d * d * 0.5 } else { (d - 0.5 * delta) * delta }
    }
);

/// The Huber loss, elementwise: (x - y)^2 / 2 where |x - y| <= delta, delta (|x - y| - delta / 2) elsewhere (Huber
/// 1964).
///
/// x and y have the same shape, or one is a single element; the result has the larger shape. Differentiable in both;
/// `delta` is constant.
///
/// ```
/// use weaver_autograd::{Tape, ops};
/// let tape = Tape::<f64>::new();
/// let (x, y) = (tape.constant(&[0.5, 3.0], [2]), tape.scalar(0.0));
/// assert_eq!(ops::huber(x, y, 1.0).to_vec(), [0.125, 2.5]);
/// ```
#[track_caller]
pub fn huber<'t, T: Real>(x: Var<'t, T>, y: Var<'t, T>, delta: f64) -> Var<'t, T> {
    apply_pointwise(Huber { delta }, [x, y])
}
