//! A residual branch with a scale per channel.

use crate::op::GRAIN;
use crate::{Backward, Grad, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, parallel, reduce::column_sums};

#[derive(Debug)]
struct ScaleResidual;

/// The elements of a task, which takes whole rows of `width`.
fn chunk(width: usize) -> usize {
    GRAIN.div_ceil(width.max(1)) * width.max(1)
}

impl<T: Real> Op<T> for ScaleResidual {
    fn name(&self) -> &'static str {
        "scale_residual"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(
            ins.len() == 3 && ins[0].rank() > 0 && ins[0] == ins[2] && ins[1] == Shape::from([ins[0].last()]),
            "x [.., D], gamma [D], y [.., D]"
        );
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let (x, gamma, y) = (&ins[0], &ins[1], &ins[2]);
        let size = chunk(gamma.len());
        parallel::for_chunks(&mut outs[0], size, |i, out| {
            let (x, y) = (&x[i * size..][..out.len()], &y[i * size..][..out.len()]);
            let rows = x.chunks_exact(gamma.len()).zip(y.chunks_exact(gamma.len()));
            for (out, (x, y)) in out.chunks_exact_mut(gamma.len()).zip(rows) {
                for (((out, x), y), g) in out.iter_mut().zip(x).zip(y).zip(gamma.iter()) {
                    *out = *x + *g * *y;
                }
            }
        });
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, pool, .. } = at;
        let (gamma, y, dout) = (&ins[1], &ins[2], &douts[0]);
        if let Some(dx) = &mut dins[0] {
            dx.add(dout);
        }
        if let Some(dgamma) = &mut dins[1] {
            let mut products = pool.buffer(y.len());
            Grad::new(&mut products, true).add_each(|i| dout[i] * y[i]);
            column_sums(y.shape().rows(), gamma.len(), &products, dgamma.target());
        }
        if let Some(dy) = &mut dins[2] {
            let size = chunk(gamma.len());
            let (dy, beta) = dy.target();
            parallel::for_chunks(dy, size, |i, dy| {
                let dout = &dout[i * size..][..dy.len()];
                for (dy, dout) in dy.chunks_exact_mut(gamma.len()).zip(dout.chunks_exact(gamma.len())) {
                    for ((dy, dout), g) in dy.iter_mut().zip(dout).zip(gamma.iter()) {
                        *dy = if beta == T::ZERO { *dout * *g } else { *dy + *dout * *g };
                    }
                }
            });
        }
    }
}

/// A residual connection with LayerScale: x + gamma * y, with one factor per channel (Touvron et al., arXiv
/// 2103.17239).
///
/// x and y `[.., D]`, gamma `[D]`; the result is `[.., D]`. Differentiable in all three.
///
/// ```
/// use weaver_autograd::{Tape, ops};
/// let tape = Tape::<f64>::new();
/// let [x, gamma, y] = [[1.0, 1.0], [0.5, 2.0], [4.0, 3.0]].map(|row| tape.constant(&row, [2]));
/// assert_eq!(ops::scale_residual(x, gamma, y).to_vec(), [3.0, 7.0]);
/// ```
#[track_caller]
pub fn scale_residual<'t, T: Real>(x: Var<'t, T>, gamma: Var<'t, T>, y: Var<'t, T>) -> Var<'t, T> {
    let [out] = x.tape().apply(ScaleResidual, &[x, gamma, y]);
    out
}
