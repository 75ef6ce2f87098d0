//! Two fully connected layers with a rectifier between them, as the checkpoint names them.

use weaver_autograd::ops::Activation;
use weaver_autograd::{Real, Var};
use weaver_nn::{Builder, Context, Linear, WeightInit};

/// Linear `0`, rectifier, linear `2`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TwoLayers {
    hidden: Linear,
    output: Linear,
}

impl TwoLayers {
    /// Layers `inputs` -> `hidden` -> `outputs`.
    pub fn new<T: Real>(mut builder: Builder<'_, T>, inputs: usize, hidden: usize, outputs: usize) -> Self {
        Self {
            hidden: Linear::new(builder.scope(0), inputs, hidden, WeightInit::FanIn),
            output: Linear::new(builder.scope(2), hidden, outputs, WeightInit::FanIn),
        }
    }

    /// Multiplies the initial weights and biases of the output by `gain`.
    pub fn scale_output<T: Real>(&self, builder: &mut Builder<'_, T>, gain: f64) {
        for id in [Some(self.output.weight), self.output.bias].into_iter().flatten() {
            builder.value_mut(id).iter_mut().for_each(|w| *w *= T::from_f64(gain));
        }
    }

    /// Applies them to rows `[N, inputs]`.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Var<'t, T> {
        cx.layer(self.hidden.weight, "0.weight", || {
            self.output.forward(cx, self.hidden.forward_with(cx, x, Activation::Relu))
        })
    }
}
