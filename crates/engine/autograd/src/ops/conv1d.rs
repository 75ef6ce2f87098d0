//! Convolution along one axis, such as time.

use super::linear::{Activation, linear};
use crate::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, parallel};

/// Taps of a kernel.
const TAPS: usize = 3;

/// Sums the products of a kernel's taps with each step: `y_t = sum over p of x_(t + (p - 1) dilation), p`.
#[derive(Debug)]
struct GatherTaps {
    dilation: usize,
}

impl GatherTaps {
    /// For tap p the steps t of the result that it reaches, and the distance to the step that it reads.
    fn reach(&self, tap: usize, time: usize) -> (std::ops::Range<usize>, isize) {
        let shift = (tap as isize - 1) * self.dilation as isize;
        let start = shift.min(0).unsigned_abs().min(time);
        (start..time.saturating_sub(shift.max(0) as usize).max(start), shift)
    }
}

impl<T: Real> Op<T> for GatherTaps {
    fn name(&self) -> &'static str {
        "gather_taps"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 1 && ins[0].rank() == 3 && ins[0][2].is_multiple_of(TAPS), "x [B, T, {TAPS} D]");
        Ok(Shapes::one(ins[0].with_last(ins[0][2] / TAPS)))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let (time, width) = (outs[0].shape()[1], outs[0].shape()[2]);
        parallel::for_chunks(&mut outs[0], time * width, |b, y| {
            let x = &ins[0][b * TAPS * time * width..][..TAPS * time * width];
            y.fill(T::ZERO);
            for tap in 0..TAPS {
                let (reached, shift) = self.reach(tap, time);
                for t in reached {
                    let from = (t as isize + shift) as usize * TAPS * width + tap * width;
                    y[t * width..][..width].iter_mut().zip(&x[from..]).for_each(|(y, x)| *y += *x);
                }
            }
        });
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { douts, dins, .. } = at;
        let Some(dx) = &mut dins[0] else { return };
        let (time, width) = (douts[0].shape()[1], douts[0].shape()[2]);
        parallel::for_chunks(dx.accumulator(), TAPS * time * width, |b, dx| {
            let dy = &douts[0][b * time * width..][..time * width];
            for tap in 0..TAPS {
                let (reached, shift) = self.reach(tap, time);
                for t in reached {
                    let to = (t as isize + shift) as usize * TAPS * width + tap * width;
                    dx[to..][..width].iter_mut().zip(&dy[t * width..]).for_each(|(dx, dy)| *dx += *dy);
                }
            }
        });
    }
}

/// Convolution of width 3 along time, padded with zeros: `y_t = b + sum over p of w_p x_(t + (p - 1) dilation)`.
///
/// x `[B, T, in]`, w `[out, in, 3]` as PyTorch's Conv1d has it, b `[out]`; the result is `[B, T, out]`. Differentiable
/// in all three. One product with all taps, whose results are then shifted: good where there are far more channels than
/// outputs.
///
/// ```
/// use weaver_autograd::{Tape, ops};
/// let tape = Tape::<f32>::new();
/// let (x, w) = (tape.constant(&[1.0, 2.0, 3.0], [1, 3, 1]), tape.constant(&[100.0, 10.0, 1.0], [1, 1, 3]));
/// let b = tape.constant(&[0.0], [1]);
/// assert_eq!(ops::conv1d(x, w, b, 1).to_vec(), [12.0, 123.0, 230.0]);
/// ```
#[track_caller]
pub fn conv1d<'t, T: Real>(x: Var<'t, T>, w: Var<'t, T>, b: Var<'t, T>, dilation: usize) -> Var<'t, T> {
    let shape = w.shape();
    let fits = x.shape().rank() == 3 && shape.rank() == 3 && shape[2] == TAPS && x.shape()[2] == shape[1];
    x.tape().ensure_shapes(fits, "conv1d", "x [B, T, in], w [out, in, 3]", &[x.shape(), shape]);
    let by_tap = w.permute(&[2, 0, 1]).reshape([TAPS * shape[0], shape[1]]);
    let taps = linear(x, by_tap, None, Activation::None);
    let [y] = x.tape().apply(GatherTaps { dilation }, &[taps]);
    y + b.expand(y.shape())
}
