//! The logarithm of softmax along an axis.

use crate::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, parallel};

#[derive(Debug)]
struct LogSoftmax {
    axis: usize,
}

impl<T: Real> Op<T> for LogSoftmax {
    fn name(&self) -> &'static str {
        "log_softmax"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 1 && self.axis < ins[0].rank(), "a tensor with an axis {}", self.axis);
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let [_, len, inner] = ins[0].shape().around(self.axis);
        let x = &ins[0];
        parallel::for_chunks(&mut outs[0], len * inner, |block, y| {
            let x = &x[block * len * inner..][..len * inner];
            for lane in 0..inner {
                let xs = x[lane..].iter().step_by(inner);
                let max = xs.clone().copied().fold(-T::INFINITY, T::max);
                let shift = max + xs.clone().map(|x| (*x - max).exp()).sum::<T>().ln();
                y[lane..].iter_mut().step_by(inner).zip(xs).for_each(|(y, x)| *y = *x - shift);
            }
        });
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { outs, douts, dins, .. } = at;
        let Some(dx) = &mut dins[0] else { return };
        let [_, len, inner] = outs[0].shape().around(self.axis);
        let (dx, beta) = dx.target();
        parallel::for_chunks(dx, len * inner, |block, dx| {
            let part = block * len * inner..(block + 1) * len * inner;
            let (y, dy) = (&outs[0][part.clone()], &douts[0][part]);
            for lane in 0..inner {
                let dys = dy[lane..].iter().step_by(inner);
                let sum: T = dys.clone().copied().sum();
                let terms = y[lane..].iter().step_by(inner).zip(dys);
                for (dx, (y, dy)) in dx[lane..].iter_mut().step_by(inner).zip(terms) {
                    let d = *dy - y.exp() * sum;
                    *dx = if beta == T::ZERO { d } else { *dx + d };
                }
            }
        });
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// The natural logarithm of softmax along an axis, x - ln(sum of e^x), accurate where [`softmax`](Var::softmax)
    /// underflows.
    ///
    /// x is `[.., A, ..]`, and so is the result. Differentiable. Panics if x has no such axis.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[1000.0, 0.0], [2]).log_softmax(0).to_vec(), [0.0, -1000.0]);
    /// ```
    #[track_caller]
    pub fn log_softmax(self, axis: usize) -> Self {
        let [y] = self.tape().apply(LogSoftmax { axis }, &[self]);
        y
    }
}
