//! Softmax along an axis.

use crate::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, softmax};

#[derive(Debug)]
struct Softmax {
    axis: usize,
}

impl<T: Real> Op<T> for Softmax {
    fn name(&self) -> &'static str {
        "softmax"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 1 && self.axis < ins[0].rank(), "a tensor with an axis {}", self.axis);
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let [_, len, inner] = ins[0].shape().around(self.axis);
        softmax::softmax_forward(len, inner, &ins[0], &mut outs[0]);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { outs, douts, dins, .. } = at;
        if let Some(dx) = &mut dins[0] {
            let [_, len, inner] = outs[0].shape().around(self.axis);
            softmax::softmax_backward(len, inner, &outs[0], &douts[0], dx.target());
        }
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// Softmax along an axis: e^x / sum of e^x. The maximum is subtracted first, so that nothing overflows.
    ///
    /// x is `[.., A, ..]`, and so is the result. Differentiable. Panics if x has no such axis.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[7.0, 7.0, 1.0, 1.0], [2, 2]).softmax(1).to_vec(), [0.5; 4]);
    /// ```
    #[track_caller]
    pub fn softmax(self, axis: usize) -> Self {
        let [y] = self.tape().apply(Softmax { axis }, &[self]);
        y
    }
}
