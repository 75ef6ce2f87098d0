//! Elementwise ops that are defined by one expression; dual numbers give the derivative.

use crate::op::GRAIN;
use crate::{Backward, Dual, Op, Pool, Shape, ShapeError, Shapes, View, ViewMut, ensure_shape};
use std::fmt::Debug;
use weaver_kernels::{Real, parallel, simd};

/// An elementwise function of `N` inputs; [`pointwise!`](crate::pointwise) writes the implementation.
pub trait Pointwise<const N: usize>: Debug + Send + Sync + 'static {
    /// The name of the op.
    const NAME: &'static str;

    /// Evaluates the function on dual numbers.
    fn eval<T: Real>(&self, inputs: [Dual<T, N>; N]) -> Dual<T, N>;
}

/// The op that applies a [`Pointwise`] function. All inputs have the same shape, or a single element that is broadcast.
#[derive(Debug)]
pub struct PointwiseOp<F, const N: usize>(pub F);

/// Elements that are evaluated at a time: loops over arrays of this length vectorize.
const BLOCK: usize = 32;

/// Elements `start..start + length` of every input, padded with 1; a single element is repeated.
#[inline(always)]
fn load<T: Real, const N: usize>(ins: &[View<'_, T>], start: usize, length: usize) -> [[T; BLOCK]; N] {
    let mut block = [[T::ONE; BLOCK]; N];
    for k in 0..N {
        match ins[k].len() {
            1 => block[k].fill(ins[k][0]),
            _ => block[k][..length].copy_from_slice(&ins[k][start..start + length]),
        }
    }
    block
}

impl<F: Pointwise<N>, const N: usize> PointwiseOp<F, N> {
    /// `dy` times the derivative with respect to input k, at elements `start..start + length`.
    #[inline(always)]
    fn slopes<T: Real>(&self, k: usize, ins: &[View<'_, T>], dy: &[T], start: usize, length: usize) -> [T; BLOCK] {
        let xs: [_; N] = load(ins, start, length);
        let mut slopes = [T::ZERO; BLOCK];
        slopes[..length].copy_from_slice(&dy[start..start + length]);
        for i in 0..BLOCK {
            let x: [T; N] = std::array::from_fn(
                #[inline(always)]
                |k| xs[k][i],
            );
            slopes[i] *= self.0.eval(Dual::inputs(x)).partial[k];
        }
        slopes
    }
}

impl<T: Real, F: Pointwise<N>, const N: usize> Op<T> for PointwiseOp<F, N> {
    fn name(&self) -> &'static str {
        F::NAME
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == N, "{N} inputs");
        let shape = ins.iter().copied().max_by_key(|s| (s.len() != 1, s.rank())).unwrap_or(Shape::SCALAR);
        ensure_shape!(
            ins.iter().all(|s| s.len() == 1 || *s == shape),
            "inputs of one shape {shape}, or of a single element"
        );
        Ok(Shapes::one(shape))
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        parallel::for_chunks(&mut outs[0], GRAIN, |chunk, out| {
            simd::dispatch(
                #[inline(always)]
                || {
                    for (b, out) in out.chunks_mut(BLOCK).enumerate() {
                        let xs: [_; N] = load(ins, chunk * GRAIN + b * BLOCK, out.len());
                        let mut ys = [T::ZERO; BLOCK];
                        for i in 0..BLOCK {
                            let x: [T; N] = std::array::from_fn(
                                #[inline(always)]
                                |k| xs[k][i],
                            );
                            ys[i] = self.0.eval(x.map(Dual::constant)).value;
                        }
                        out.copy_from_slice(&ys[..out.len()]);
                    }
                },
            );
        });
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, outs, douts, dins, .. } = at;
        let total = outs[0].len();
        for (k, din) in dins.iter_mut().enumerate() {
            let Some(din) = din else { continue };
            if ins[k].len() == 1 && total != 1 {
                // Blocks are added in order, which fixes the order of summation.
                let mut sums = [T::ZERO; BLOCK];
                for start in (0..total).step_by(BLOCK) {
                    let length = BLOCK.min(total - start);
                    let slopes = self.slopes(k, ins, &douts[0], start, length);
                    sums[..length].iter_mut().zip(slopes).for_each(|(sum, slope)| *sum += slope);
                }
                din.add(&[sums.into_iter().sum()]);
                continue;
            }
            let (data, beta) = din.target();
            parallel::for_chunks(data, GRAIN, |chunk, out| {
                simd::dispatch(
                    #[inline(always)]
                    || {
                        for (b, out) in out.chunks_mut(BLOCK).enumerate() {
                            let slopes = self.slopes(k, ins, &douts[0], chunk * GRAIN + b * BLOCK, out.len());
                            let slopes = &slopes[..out.len()];
                            if beta == T::ZERO {
                                out.copy_from_slice(slopes);
                            } else {
                                out.iter_mut().zip(slopes).for_each(|(g, s)| *g += *s);
                            }
                        }
                    },
                );
            });
        }
    }
}

/// Defines a differentiable elementwise function from one expression.
///
/// `pointwise!(Silu, 1, |x| x / (1 + (-x).exp()))` defines a type `Silu` for a function of one input, and
/// `pointwise!(Affine { a: f64, b: f64 }, 1, |x| x * a + b)` one with constants as fields. The expression is evaluated
/// on [`Dual`] numbers, so that value and derivative always agree. Apply it with [`Var::map`](crate::Var::map) (one
/// input) or [`apply_pointwise`](crate::apply_pointwise) (any number).
///
/// ```
/// use weaver_autograd::{Tape, pointwise};
/// pointwise!(
///     /// x * sigmoid(x).
///     pub Swish, 1, |x| x / (1 + (-x).exp())
/// );
/// let tape = Tape::<f64>::new();
/// let x = tape.leaf(&[0.0], [1]);
/// let y = x.map(Swish);
/// y.backward();
/// assert_eq!((y.item(), x.grad().unwrap()[0]), (0.0, 0.5));
/// ```
#[macro_export]
macro_rules! pointwise {
    ($(#[$doc:meta])* $vis:vis $name:ident, $n:literal, |$($x:ident),+| $body:expr) => {
        $crate::pointwise!($(#[$doc])* $vis $name {}, $n, |$($x),+| $body);
    };
    ($(#[$doc:meta])* $vis:vis $name:ident { $($field:ident : $ty:ty),* $(,)? }, $n:literal, |$($x:ident),+| $body:expr) => {
        $crate::pointwise!(@struct $(#[$doc])* $vis $name { $($field : $ty),* });
        impl $crate::Pointwise<$n> for $name {
            const NAME: &'static str = stringify!($name);
            #[inline(always)]
            fn eval<T: $crate::Real>(&self, inputs: [$crate::Dual<T, $n>; $n]) -> $crate::Dual<T, $n> {
                $(let $field = self.$field;)*
                let [$($x),+] = inputs;
                $body
            }
        }
    };
    (@struct $(#[$doc:meta])* $vis:vis $name:ident {}) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        $vis struct $name;
    };
    (@struct $(#[$doc:meta])* $vis:vis $name:ident { $($field:ident : $ty:ty),+ }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        $vis struct $name { $(
            /// A constant of the expression.
            pub $field: $ty
        ),+ }
    };
}
