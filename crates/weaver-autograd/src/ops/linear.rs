//! A fully connected layer with its activation, fused.

use crate::op::GRAIN;
use crate::{Buffer, Grad, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::gelu::{gelu_backward, gelu_forward};
use weaver_kernels::gemm::{gemm, gemm_half, gemm_half_scratch_len};
use weaver_kernels::{Real, parallel, reduce::column_sums};

/// What is applied to the result of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Activation {
    /// Nothing.
    #[default]
    None,
    /// max(x, 0).
    Relu,
    /// x times the standard normal distribution function at x.
    Gelu,
}

#[derive(Debug)]
struct Linear<T: Real> {
    activation: Activation,
    /// x W^T + b, where the derivative of the activation needs it.
    sums: Option<Buffer<T>>,
}

/// dx = dy, but 0 where y is 0.
fn relu_backward<T: Real>(y: &[T], dy: &[T], dx: &mut [T]) {
    parallel::for_chunks(dx, GRAIN, |chunk, dx| {
        let part = chunk * GRAIN..chunk * GRAIN + dx.len();
        for (dx, (y, dy)) in dx.iter_mut().zip(y[part.clone()].iter().zip(&dy[part])) {
            *dx = if *y <= T::ZERO { T::ZERO } else { *dy };
        }
    });
}

impl<T: Real> Op<T> for Linear<T> {
    fn name(&self) -> &'static str {
        "linear"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let (x, w) = (ins[0], ins[1]);
        ensure_shape!(
            x.rank() > 0 && w.rank() == 2 && x.last() == w[1] && ins.get(2).is_none_or(|b| *b == Shape::from([w[0]])),
            "x [.., in], w [out, in], b [out]"
        );
        Ok(Shapes::one(x.with_last(w[0])))
    }
    fn reads_half(&self, index: usize) -> bool {
        index == 1
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool) {
        let (x, w, y) = (&ins[0], &ins[1], &mut *outs[0]);
        let (rows, n, k) = (x.shape().rows(), w.shape()[0], w.shape()[1]);
        let product = |y: &mut [T]| {
            let beta = ins.get(2).map_or(T::ZERO, |b| {
                parallel::fill_rows(b, y);
                T::ONE
            });
            match w.half() {
                Some(w) => {
                    let mut scratch = pool.buffer(gemm_half_scratch_len(rows, k, w));
                    gemm_half(rows, n, k, x, w, beta, y, &mut scratch);
                }
                None => gemm(false, true, rows, n, k, T::ONE, x, w, beta, y),
            }
        };
        match self.activation {
            Activation::None => product(y),
            Activation::Relu => {
                product(y);
                parallel::for_chunks(y, GRAIN, |_, y| {
                    y.iter_mut().filter(|y| **y < T::ZERO).for_each(|y| *y = T::ZERO)
                });
            }
            Activation::Gelu => {
                let mut sums = pool.buffer(y.len());
                product(&mut sums);
                gelu_forward(&sums, y);
                self.sums = Some(sums);
            }
        }
    }
    fn backward(
        &self,
        ins: &[View<'_, T>],
        outs: &[View<'_, T>],
        douts: &[View<'_, T>],
        dins: &mut [Option<Grad<'_, T>>],
        pool: &Pool,
    ) {
        let (x, w) = (&ins[0], &ins[1]);
        let (rows, n, k) = (x.shape().rows(), w.shape()[0], w.shape()[1]);
        let chained = match (self.activation, &self.sums) {
            (Activation::None, _) => None,
            (_, sums) => {
                let mut dsums = pool.buffer(douts[0].len());
                match sums {
                    Some(sums) => gelu_backward(sums, &douts[0], (&mut dsums, T::ZERO)),
                    // The result is positive exactly where the sum was.
                    None => relu_backward(&outs[0], &douts[0], &mut dsums),
                }
                Some(dsums)
            }
        };
        let dsums: &[T] = chained.as_deref().unwrap_or(&douts[0]);
        if let Some(dx) = &mut dins[0] {
            let (dx, beta) = dx.target();
            let wide = w.half().map(|half| {
                let mut wide = pool.buffer(half.len());
                half.widen(&mut wide);
                wide
            });
            gemm(false, false, rows, k, n, T::ONE, dsums, wide.as_deref().unwrap_or(w), beta, dx);
        }
        if let Some(dw) = &mut dins[1] {
            let (dw, beta) = dw.target();
            gemm(true, false, n, k, rows, T::ONE, dsums, x, beta, dw);
        }
        if let Some(Some(db)) = dins.get_mut(2) {
            column_sums(rows, n, dsums, db.target());
        }
    }
}

/// act(x W^T + b), a fully connected layer in one op.
///
/// x `[.., in]`, w `[out, in]`, b `[out]` or none; the result is `[.., out]`. Differentiable in all three. W may be a
/// parameter in half precision, which is constant.
///
/// ```
/// use weaver_autograd::{Tape, ops, ops::Activation};
/// let tape = Tape::<f32>::new();
/// let (x, w) = (tape.constant(&[1.0, 2.0], [1, 2]), tape.constant(&[3.0, 4.0, -1.0, 0.0], [2, 2]));
/// assert_eq!(ops::linear(x, w, None, Activation::Relu).to_vec(), [11.0, 0.0]);
/// ```
#[track_caller]
pub fn linear<'t, T: Real>(x: Var<'t, T>, w: Var<'t, T>, b: Option<Var<'t, T>>, activation: Activation) -> Var<'t, T> {
    let op = Linear { activation, sums: None };
    let [y] = match b {
        Some(b) => x.tape().apply(op, &[x, w, b]),
        None => x.tape().apply(op, &[x, w]),
    };
    y
}
