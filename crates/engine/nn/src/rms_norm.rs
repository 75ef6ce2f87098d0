//! Root-mean-square normalization with learned scale.

use crate::{Builder, Context, Init};
use weaver_autograd::{ParamId, Real, Var};

/// Root-mean-square normalization over the last axis, x / sqrt(mean(x^2) + eps) * weight; parameter `weight` `[D]`, at
/// first 1.
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// use weaver_nn::{Builder, Context, RmsNorm};
/// let mut params = Params::<f64>::new();
/// let layer = RmsNorm::new(Builder::new(&mut params, 0).scope("norm"), 2, 0.0);
/// let tape = Tape::new();
/// let y = layer.forward(Context::new(&tape, &params), tape.constant(&[2.0, -2.0], [1, 2]));
/// assert_eq!(y.to_vec(), [1.0, -1.0]);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct RmsNorm {
    /// `weight`, `[D]`.
    pub weight: ParamId,
    /// Added to the mean square.
    pub eps: f64,
}

impl RmsNorm {
    /// A layer for rows of `width` numbers.
    pub fn new<T: Real>(mut builder: Builder<'_, T>, width: usize, eps: f64) -> Self {
        Self { weight: builder.add("weight", [width], Init::Constant(1.0)), eps }
    }

    /// Applies it to x `[.., D]`, which gives the same shape. Differentiable in x and the parameter.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Var<'t, T> {
        cx.layer(self.weight, "weight", || x.rms_norm(cx.param(self.weight), self.eps))
    }
}
