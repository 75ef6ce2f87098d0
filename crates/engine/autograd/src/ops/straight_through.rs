//! The value of one tensor with the gradient of another.

use crate::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::Real;

#[derive(Debug)]
struct StraightThrough;

impl<T: Real> Op<T> for StraightThrough {
    fn name(&self) -> &'static str {
        "straight_through"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 2 && ins[0] == ins[1], "two tensors of one shape");
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        outs[0].copy_from_slice(&ins[1]);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { douts, dins, .. } = at;
        if let Some(dsoft) = &mut dins[0] {
            dsoft.add(&douts[0]);
        }
    }
    fn differentiable(&self, index: usize) -> bool {
        index == 0
    }
}

/// The straight-through estimator: the value of `hard` with the gradient of `soft` (Bengio et al., arXiv 1308.3432).
///
/// `soft`, `hard` and the result have the same shape. The gradient with respect to the result goes to `soft` unchanged;
/// `hard` is treated as a constant.
///
/// ```
/// use weaver_autograd::{Tape, ops};
/// let tape = Tape::<f64>::new();
/// let (soft, hard) = (tape.leaf(&[0.7, 0.3], [2]), tape.constant(&[1.0, 0.0], [2]));
/// let y = ops::straight_through(soft, hard);
/// y.sum().backward();
/// assert_eq!((y.to_vec(), soft.grad().unwrap()), (vec![1.0, 0.0], vec![1.0, 1.0]));
/// ```
#[track_caller]
pub fn straight_through<'t, T: Real>(soft: Var<'t, T>, hard: Var<'t, T>) -> Var<'t, T> {
    let [y] = soft.tape().apply(StraightThrough, &[soft, hard.detach()]);
    y
}
