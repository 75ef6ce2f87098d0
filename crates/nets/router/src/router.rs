//! The pixel router.

use weaver_autograd::ops::{self, Activation};
use weaver_autograd::{Real, Var};
use weaver_nn::{Builder, Context, Conv2d, WeightInit};

/// Initial bias of the logits; further ones are 0. Softmax of four such logits: 56 % nothing, 34 % one Gaussian.
const FIRST_LOGITS: [f64; 2] = [2.5, 2.0];

/// Scores the experts for every pixel: 1 x 1 convolution, rectifier, 1 x 1 convolution.
///
/// Parameters (below the builder's path): `0.weight` `[hidden, F, 1, 1]`, `0.bias`, `2.weight` `[E, hidden, 1, 1]`,
/// `2.bias`, whose first values are (2.5, 2, 0, ...).
#[derive(Clone, Copy, Debug)]
pub struct Router {
    hidden: Conv2d,
    output: Conv2d,
}

impl Router {
    /// A router of F = `features` channels over `experts` experts, expert 0 (nothing) included.
    pub fn new<T: Real>(mut builder: Builder<'_, T>, features: usize, hidden: usize, experts: usize) -> Self {
        let router = Self {
            hidden: Conv2d::new(builder.scope(0), features, hidden, 1, WeightInit::FanIn),
            output: Conv2d::new(builder.scope(2), hidden, experts, 1, WeightInit::FanIn),
        };
        let bias = builder.value_mut(router.output.bias.expect("a new convolution has a bias"));
        bias.fill(T::ZERO);
        bias.iter_mut().zip(FIRST_LOGITS).for_each(|(b, first)| *b = T::from_f64(first));
        router
    }

    /// Logits `[P, E]` from router features `[P, F]`. Differentiable in the features and all parameters.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, features: Var<'t, T>) -> Var<'t, T> {
        cx.part("gating", || {
            let hidden = on_rows(&self.hidden, cx, features, Activation::Relu);
            on_rows(&self.output, cx, hidden, Activation::None)
        })
    }
}

/// A 1 x 1 convolution of pixels that are rows is a fully connected layer.
fn on_rows<'t, T: Real>(conv: &Conv2d, cx: Context<'t, '_, T>, x: Var<'t, T>, activation: Activation) -> Var<'t, T> {
    let weight = cx.param(conv.weight);
    let matrix = weight.reshape([weight.shape()[0], weight.shape()[1]]);
    ops::linear(x, matrix, conv.bias.map(|b| cx.param(b)), activation)
}
