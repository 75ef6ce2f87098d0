//! Layer normalization with learned scale and shift.

use crate::{Builder, Context, Init};
use weaver_autograd::{ParamId, Real, Var};

/// Layer normalization over the last axis, (x - mean) / sqrt(variance + eps) * weight + bias; parameters `weight` and,
/// unless left out, `bias` `[D]`, at first 1 and 0.
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// use weaver_nn::{Builder, Context, LayerNorm};
/// let mut params = Params::<f64>::new();
/// let layer = LayerNorm::new(Builder::new(&mut params, 0).scope("norm"), 2, 0.0);
/// let tape = Tape::new();
/// let y = layer.forward(Context::new(&tape, &params), tape.constant(&[1.0, 3.0], [1, 2]));
/// assert_eq!(y.to_vec(), [-1.0, 1.0]);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct LayerNorm {
    /// `weight`, `[D]`.
    pub weight: ParamId,
    /// `bias`, `[D]`, if there is one.
    pub bias: Option<ParamId>,
    /// Added to the variance.
    pub eps: f64,
}

impl LayerNorm {
    /// A layer for rows of `width` numbers.
    pub fn new<T: Real>(mut builder: Builder<'_, T>, width: usize, eps: f64) -> Self {
        let weight = builder.add("weight", [width], Init::Constant(1.0));
        Self { weight, bias: Some(builder.add("bias", [width], Init::Constant(0.0))), eps }
    }

    /// A layer for rows of `width` numbers that scales and does not shift.
    pub fn without_bias<T: Real>(mut builder: Builder<'_, T>, width: usize, eps: f64) -> Self {
        Self { weight: builder.add("weight", [width], Init::Constant(1.0)), bias: None, eps }
    }

    /// Applies it to x `[.., D]`, which gives the same shape. Differentiable in x and the parameters.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Var<'t, T> {
        cx.layer(self.weight, "weight", || {
            let weight = cx.param(self.weight);
            let zeros = || cx.tape.constant_with(weight.shape(), |_| ());
            x.layer_norm(Some((weight, self.bias.map_or_else(zeros, |bias| cx.param(bias)))), self.eps)
        })
    }
}
