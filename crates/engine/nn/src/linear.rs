//! A fully connected layer.

use crate::{Builder, Context, WeightInit};
use weaver_autograd::ops::{self, Activation};
use weaver_autograd::{ParamId, Real, Var};

/// x W^T + b; parameters `weight` `[out, in]` and `bias` `[out]`.
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// use weaver_nn::{Builder, Context, Linear, WeightInit};
/// let mut params = Params::<f32>::new();
/// let layer = Linear::new(Builder::new(&mut params, 0).scope("head"), 3, 2, WeightInit::FanIn);
/// let tape = Tape::new();
/// let y = layer.forward(Context::new(&tape, &params), tape.constant(&[0.0; 12], [2, 2, 3]));
/// assert_eq!(y.shape().dims(), [2, 2, 2]);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Linear {
    /// `weight`, `[out, in]`.
    pub weight: ParamId,
    /// `bias`, `[out]`, if there is one.
    pub bias: Option<ParamId>,
}

impl Linear {
    /// A layer from `inputs` to `outputs` numbers.
    pub fn new<T: Real>(mut builder: Builder<'_, T>, inputs: usize, outputs: usize, init: WeightInit) -> Self {
        let (weights, biases) = init.of(inputs);
        let weight = builder.add("weight", [outputs, inputs], weights);
        Self { weight, bias: Some(builder.add("bias", [outputs], biases)) }
    }

    /// A layer from `inputs` to `outputs` numbers that adds no bias.
    pub fn without_bias<T: Real>(mut builder: Builder<'_, T>, inputs: usize, outputs: usize, init: WeightInit) -> Self {
        Self { weight: builder.add("weight", [outputs, inputs], init.of(inputs).0), bias: None }
    }

    /// Applies it to x `[.., in]`, which gives `[.., out]`. Differentiable in x and the parameters.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Var<'t, T> {
        self.forward_with(cx, x, Activation::None)
    }

    /// Applies it to x `[.., in]`, then the activation in the same kernel, which gives `[.., out]`. Differentiable in x
    /// and the parameters.
    pub fn forward_with<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        x: Var<'t, T>,
        activation: Activation,
    ) -> Var<'t, T> {
        cx.layer(self.weight, "weight", || {
            ops::linear(x, cx.param(self.weight), self.bias.map(|b| cx.param(b)), activation)
        })
    }
}
