//! Heads that score snippets.

use weaver_autograd::ops::Activation;
use weaver_autograd::{Real, Var};
use weaver_nn::{Builder, Context, Linear, WeightInit};

/// Probabilities sigmoid(W2 ReLU(W1 z)); parameters `0` and `2`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScoreHead {
    hidden: Linear,
    out: Linear,
}

impl ScoreHead {
    pub fn new<T: Real>(mut builder: Builder<'_, T>, inputs: usize, hidden: usize, outputs: usize) -> Self {
        Self {
            hidden: Linear::new(builder.scope("0"), inputs, hidden, WeightInit::FanIn),
            out: Linear::new(builder.scope("2"), hidden, outputs, WeightInit::FanIn),
        }
    }

    /// z `[.., inputs]` gives `[.., outputs]`, in (0, 1).
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, z: Var<'t, T>) -> Var<'t, T> {
        self.out.forward(cx, self.hidden.forward_with(cx, z, Activation::Relu)).sigmoid()
    }
}
