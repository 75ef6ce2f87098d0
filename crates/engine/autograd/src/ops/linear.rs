//! A fully connected layer, fused with its activation.

use crate::op::GRAIN;
use crate::{Backward, Buffer, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::gelu::{gelu_backward, gelu_forward};
use weaver_kernels::gemm::{Mat, MatMut, gemm, gemm_half, gemm_half_scratch_len};
use weaver_kernels::{Real, parallel, reduce::column_sums};

/// The activation function of a [`linear`] layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Activation {
    /// No activation.
    #[default]
    None,
    /// The rectified linear unit, max(x, 0).
    Relu,
    /// The Gaussian error linear unit in its exact form, x (1 + erf(x / sqrt 2)) / 2.
    Gelu,
}

#[derive(Debug)]
struct Linear<T: Real> {
    activation: Activation,
    /// x W^T + b, if the derivative of the activation needs it.
    sums: Option<Buffer<T>>,
}

/// The gradient of ReLU from its result: dy where y is positive, 0 elsewhere.
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
            let (x, y) = (Mat::new(x, rows, k), MatMut::new(y, rows, n));
            match w.half() {
                Some(w) => {
                    let mut scratch = pool.buffer(gemm_half_scratch_len(rows, k, w));
                    gemm_half(x, w, beta, y, &mut scratch);
                }
                None => gemm(T::ONE, x, Mat::new(w, n, k).transposed(), beta, y),
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
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, outs, douts, dins, pool } = at;
        let (x, w) = (&ins[0], &ins[1]);
        let (rows, n, k) = (x.shape().rows(), w.shape()[0], w.shape()[1]);
        let chained = match (self.activation, &self.sums) {
            (Activation::None, _) => None,
            (_, sums) => {
                let mut dsums = pool.buffer(douts[0].len());
                match sums {
                    Some(sums) => gelu_backward(sums, &douts[0], (&mut dsums, T::ZERO)),
                    // The result of ReLU is positive exactly where its input is.
                    None => relu_backward(&outs[0], &douts[0], &mut dsums),
                }
                Some(dsums)
            }
        };
        let dsums: &[T] = chained.as_deref().unwrap_or(&douts[0]);
        let dsums_matrix = Mat::new(dsums, rows, n);
        if let Some(dx) = &mut dins[0] {
            let (dx, beta) = dx.target();
            let wide = w.half().map(|half| {
                let mut wide = pool.buffer(half.len());
                half.widen(&mut wide);
                wide
            });
            let w = Mat::new(wide.as_deref().unwrap_or(w), n, k);
            gemm(T::ONE, dsums_matrix, w, beta, MatMut::new(dx, rows, k));
        }
        if let Some(dw) = &mut dins[1] {
            let (dw, beta) = dw.target();
            gemm(T::ONE, dsums_matrix.transposed(), Mat::new(x, rows, k), beta, MatMut::new(dw, n, k));
        }
        if let Some(Some(db)) = dins.get_mut(2) {
            column_sums(rows, n, dsums, db.target());
        }
    }
}

/// A fully connected layer: activation(x W^T + b).
///
/// x is `[.., in]`, w `[out, in]`, b `[out]` or left out; the result is `[.., out]`. Differentiable in all three. w may
/// be a parameter in half precision, which is constant.
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
