//! Sums and means along an axis.

use crate::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, parallel, reduce::row_sums};

#[derive(Debug)]
struct SumAxis {
    axis: usize,
}

impl<T: Real> Op<T> for SumAxis {
    fn name(&self) -> &'static str {
        "sum_axis"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 1 && self.axis < ins[0].rank(), "a tensor with an axis {}", self.axis);
        Ok(Shapes::one(ins[0].without_axis(self.axis)))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let [_, len, inner] = ins[0].shape().around(self.axis);
        let x = &ins[0];
        if inner == 1 {
            return row_sums(outs[0].len(), len, x, (&mut outs[0], T::ZERO));
        }
        parallel::for_chunks(&mut outs[0], inner, |o, y| {
            y.fill(T::ZERO);
            for row in x[o * len * inner..(o + 1) * len * inner].chunks_exact(inner) {
                y.iter_mut().zip(row).for_each(|(y, x)| *y += *x);
            }
        });
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let Some(dx) = &mut dins[0] else { return };
        let [_, len, inner] = ins[0].shape().around(self.axis);
        let (dx, beta) = dx.target();
        parallel::for_chunks(dx, len * inner, |o, dx| {
            let dy = &douts[0][o * inner..][..inner];
            for dx in dx.chunks_exact_mut(inner) {
                if beta == T::ZERO {
                    dx.copy_from_slice(dy);
                } else {
                    dx.iter_mut().zip(dy).for_each(|(dx, dy)| *dx += *dy);
                }
            }
        });
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// The sum along an axis, which is removed. The order of summation is fixed.
    ///
    /// x `[.., A, ..]` gives `[.., ..]`, 0 if A is 0. Differentiable. Panics if x has no such axis.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// assert_eq!(tape.constant(&[1.0, 2.0, 3.0, 4.0], [2, 2]).sum_axis(0).to_vec(), [4.0, 6.0]);
    /// ```
    #[track_caller]
    pub fn sum_axis(self, axis: usize) -> Self {
        let [y] = self.tape().apply(SumAxis { axis }, &[self]);
        y
    }

    /// The mean along an axis, which is removed.
    ///
    /// x `[.., A, ..]` gives `[.., ..]`, NaN if A is 0. Differentiable. Panics if x has no such axis.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// assert_eq!(tape.constant(&[1.0, 2.0, 3.0, 4.0], [2, 2]).mean_axis(1).to_vec(), [1.5, 3.5]);
    /// ```
    #[track_caller]
    pub fn mean_axis(self, axis: usize) -> Self {
        self.sum_axis(axis) * (1.0 / self.shape()[axis] as f64)
    }
}
