//! Normalization of rows to unit length.

use crate::op::GRAIN;
use crate::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, parallel};

#[derive(Debug)]
struct NormalizeRows {
    eps: f64,
}

fn length<T: Real>(x: &[T]) -> T {
    x.iter().map(|x| *x * *x).sum::<T>().sqrt()
}

impl NormalizeRows {
    /// The factor for a row of this length; 0 for a row of zeros.
    fn scale<T: Real>(&self, length: T) -> T {
        if length == T::ZERO { T::ZERO } else { T::ONE / (length + T::from_f64(self.eps)) }
    }
}

impl<T: Real> Op<T> for NormalizeRows {
    fn name(&self) -> &'static str {
        "normalize_rows"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 1 && ins[0].rank() > 0, "x [.., D]");
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let (x, width) = (&ins[0], ins[0].shape().last().max(1));
        let rows = GRAIN.div_ceil(width);
        parallel::for_chunks(&mut outs[0], rows * width, |chunk, y| {
            let x = &x[chunk * rows * width..];
            for (y, x) in y.chunks_exact_mut(width).zip(x.chunks_exact(width)) {
                let scale = self.scale(length(x));
                y.iter_mut().zip(x).for_each(|(y, x)| *y = *x * scale);
            }
        });
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, outs, douts, dins, .. } = at;
        let Some(dx) = &mut dins[0] else { return };
        let (x, y, dy, width) = (&ins[0], &outs[0], &douts[0], ins[0].shape().last().max(1));
        let rows = GRAIN.div_ceil(width);
        let (dx, beta) = dx.target();
        parallel::for_chunks(dx, rows * width, |chunk, dx| {
            for (r, dx) in dx.chunks_exact_mut(width).enumerate() {
                let row = (chunk * rows + r) * width..(chunk * rows + r + 1) * width;
                let (x, y, dy) = (&x[row.clone()], &y[row.clone()], &dy[row]);
                let norm = length(x);
                // dx = (dy - x (y . dy) / |x|) / (|x| + eps), and 0 for a row of zeros.
                let scale = self.scale(norm);
                let along: T = y.iter().zip(dy).map(|(y, dy)| *y * *dy).sum();
                let along = if norm == T::ZERO { T::ZERO } else { along / norm };
                for ((dx, x), dy) in dx.iter_mut().zip(x).zip(dy) {
                    let d = (*dy - *x * along) * scale;
                    *dx = if beta == T::ZERO { d } else { *dx + d };
                }
            }
        });
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// Divides every row of the last axis by its length: x / (|x| + eps). A row of zeros gives zeros and has gradient 0
    /// at any eps.
    ///
    /// x is `[.., D]`, and so is the result. Differentiable; eps is constant.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[0.0, 4.0], [1, 2]).normalize_rows(0.0).to_vec(), [0.0, 1.0]);
    /// ```
    #[track_caller]
    pub fn normalize_rows(self, eps: f64) -> Self {
        let [y] = self.tape().apply(NormalizeRows { eps }, &[self]);
        y
    }
}
