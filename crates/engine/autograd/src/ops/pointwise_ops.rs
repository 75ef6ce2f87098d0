//! The elementwise arithmetic operators of [`Var`], between tensors and with numbers.

use crate::{Pointwise, PointwiseOp, Var, pointwise};
use std::ops::{Add, Div, Mul, Neg, Sub};
use weaver_kernels::Real;

/// Applies an elementwise function of `N` inputs. Inputs have the shape of the result, or a single element that is
/// broadcast. Differentiable in all inputs.
///
/// ```
/// use weaver_autograd::{Tape, ops::pointwise_ops::{AddOp, apply_pointwise}};
/// let tape = Tape::<f32>::new();
/// let (x, y) = (tape.constant(&[1.0, 2.0], [2]), tape.scalar(10.0));
/// assert_eq!(apply_pointwise(AddOp, [x, y]).to_vec(), (x + y).to_vec());
/// ```
#[track_caller]
pub fn apply_pointwise<'t, T: Real, F: Pointwise<N>, const N: usize>(f: F, inputs: [Var<'t, T>; N]) -> Var<'t, T> {
    let [y] = inputs[0].tape().apply(PointwiseOp(f), &inputs);
    y
}

macro_rules! binary {
    ($op:ident $method:ident $f:ident, $scalar:ident, |$a:ident, $b:ident| $body:expr) => {
        pointwise!(
            #[doc = concat!("Elementwise `", stringify!($body), "`.")]
            pub $f, 2, |$a, $b| $body
        );
        pointwise!(
            #[doc = concat!("Elementwise `", stringify!($body), "` with a constant.")]
            pub $scalar { $b: f64 }, 1, |$a| $body
        );
        impl<'t, T: Real> $op for Var<'t, T> {
            type Output = Var<'t, T>;
            #[track_caller]
            fn $method(self, other: Var<'t, T>) -> Var<'t, T> {
                apply_pointwise($f, [self, other])
            }
        }
        impl<'t, T: Real> $op<f64> for Var<'t, T> {
            type Output = Var<'t, T>;
            #[track_caller]
            fn $method(self, $b: f64) -> Var<'t, T> {
                self.map($scalar { $b })
            }
        }
    };
}
binary!(Add add AddOp, AddScalar, |a, b| a + b);
binary!(Sub sub SubOp, SubScalar, |a, b| a - b);
binary!(Mul mul MulOp, MulScalar, |a, b| a * b);
binary!(Div div DivOp, DivScalar, |a, b| a / b);

pointwise!(
    /// -x.
    pub NegOp, 1, |x| -x
);

impl<'t, T: Real> Neg for Var<'t, T> {
    type Output = Self;
    fn neg(self) -> Self {
        self.map(NegOp)
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// Applies an elementwise function of one input. The result has the shape of the input. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::{Tape, ops::activations::Square};
    /// let tape = Tape::<f32>::new();
    /// assert_eq!(tape.constant(&[1.0, -3.0], [2]).map(Square).to_vec(), [1.0, 9.0]);
    /// ```
    #[track_caller]
    pub fn map<F: Pointwise<1>>(self, f: F) -> Self {
        apply_pointwise(f, [self])
    }
}
