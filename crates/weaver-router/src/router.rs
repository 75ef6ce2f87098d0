//! The pixel router.

use crate::layer::{Layer, TwoLayers};
use weaver_autograd::{Real, Var};
use weaver_nn::{Builder, Context};

/// Initial bias of the logits; further ones are 0. Softmax of four such logits: 56 % nothing, 34 % one Gaussian.
const FIRST_LOGITS: [f64; 2] = [2.5, 2.0];

/// Scores the experts for every pixel: 1 x 1 convolution, rectifier, 1 x 1 convolution.
///
/// Parameters (below the builder's path): `0.weight` [hidden, F, 1, 1], `0.bias`, `2.weight` [E, hidden, 1, 1], `2.bias`,
/// whose first values are (2.5, 2, 0, ...).
#[derive(Clone, Copy, Debug)]
pub struct Router {
    layers: TwoLayers,
}

impl Router {
    /// A router of F = `features` channels over `experts` experts, expert 0 (nothing) included.
    pub fn new<T: Real>(builder: &mut Builder<'_, T>, features: usize, hidden: usize, experts: usize) -> Self {
        let layers = TwoLayers {
            hidden: Layer::convolution(builder, 0, features, hidden),
            output: Layer::convolution(builder, 2, hidden, experts),
        };
        let bias = builder.value_mut(layers.output.bias);
        bias.fill(T::ZERO);
        bias.iter_mut().zip(FIRST_LOGITS).for_each(|(b, first)| *b = T::from_f64(first));
        Self { layers }
    }

    /// Logits [P, E] from router features [P, F]. Differentiable in the features and all parameters.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, T>, features: Var<'t, T>) -> Var<'t, T> {
        let _scope = cx.scope("gating");
        self.layers.forward(cx, features)
    }
}
