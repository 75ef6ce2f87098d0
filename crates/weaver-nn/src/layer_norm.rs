//! Layer normalisation with learned scale and shift.

use crate::{Builder, Context, Init};
use weaver_autograd::{ParamId, Real, Var};

/// Layer normalisation over the last axis; parameters `weight` and `bias` `[D]`, at first 1 and 0.
#[derive(Clone, Copy, Debug)]
pub struct LayerNorm {
    /// `weight`, `[D]`.
    pub weight: ParamId,
    /// `bias`, `[D]`.
    pub bias: ParamId,
    /// Added to the variance.
    pub eps: f64,
}

impl LayerNorm {
    /// A layer for rows of `width` numbers.
    pub fn new<T: Real>(mut builder: Builder<'_, T>, width: usize, eps: f64) -> Self {
        let weight = builder.add("weight", [width], Init::Constant(1.0));
        Self { weight, bias: builder.add("bias", [width], Init::Constant(0.0)), eps }
    }

    /// Applies it to x `[.., D]`.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Var<'t, T> {
        let _layer = cx.layer(self.weight, "weight");
        x.layer_norm(Some((cx.param(self.weight), cx.param(self.bias))), self.eps)
    }
}
