//! Elementwise ops from one expression: the derivative comes from dual numbers.

use crate::op::GRAIN;
use crate::{Dual, Grad, Op, Pool, Shape, ShapeError, Shapes, View, ViewMut, ensure_shape};
use std::fmt::Debug;
use weaver_kernels::{Real, parallel};

/// An elementwise function of `N` inputs; [`pointwise!`](crate::pointwise) writes the implementation.
pub trait Pointwise<const N: usize>: Debug + Send + Sync + 'static {
    /// The op's name.
    const NAME: &'static str;

    /// The function, on dual numbers.
    fn eval<T: Real>(&self, inputs: [Dual<T, N>; N]) -> Dual<T, N>;
}

/// The op that applies a [`Pointwise`] function. All inputs have one shape, or a single element that is used for all.
#[derive(Debug)]
pub struct PointwiseOp<F, const N: usize>(pub F);

#[inline(always)]
fn gather<T: Real, const N: usize>(ins: &[View<'_, T>], single: [bool; N], i: usize) -> [T; N] {
    std::array::from_fn(|k| if single[k] { ins[k][0] } else { ins[k][i] })
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
        let single: [bool; N] = std::array::from_fn(|k| ins[k].len() == 1);
        parallel::for_chunks(&mut outs[0], GRAIN, |chunk, out| {
            let start = chunk * GRAIN;
            for (i, y) in out.iter_mut().enumerate() {
                *y = self.0.eval(gather(ins, single, start + i).map(Dual::constant)).value;
            }
        });
    }

    fn backward(
        &self,
        ins: &[View<'_, T>],
        outs: &[View<'_, T>],
        douts: &[View<'_, T>],
        dins: &mut [Option<Grad<'_, T>>],
        _pool: &Pool,
    ) {
        let single: [bool; N] = std::array::from_fn(|k| ins[k].len() == 1);
        let total = outs[0].len();
        for (k, din) in dins.iter_mut().enumerate() {
            let Some(din) = din else { continue };
            let slope = |i: usize| douts[0][i] * self.0.eval(Dual::inputs(gather(ins, single, i))).partial[k];
            if single[k] && total != 1 {
                // One chunk after the other: a fixed order of summation.
                let sum: T = (0..total).map(slope).sum();
                din.add(&[sum]);
            } else {
                din.add_each(slope);
            }
        }
    }
}

/// Defines a differentiable elementwise function from one expression.
///
/// `pointwise!(Silu, 1, |x| x / (1 + (-x).exp()))` defines the type `Silu`; `pointwise!(Affine { a: f64, b: f64 }, 1,
/// |x| x * a + b)` one with constants. The expression is evaluated on [`Dual`] numbers, so forward and derivative
/// cannot disagree. Apply it with [`Var::map`](crate::Var::map) (one input) or [`apply_pointwise`](crate::apply_pointwise).
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
