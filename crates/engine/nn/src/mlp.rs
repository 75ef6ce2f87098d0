//! Two fully connected layers with a GELU between them.

use crate::{Builder, Context, Linear, WeightInit};
use weaver_autograd::ops::Activation;
use weaver_autograd::{Real, Var};

/// fc2(GELU(fc1(x))); parameters under `fc1` and `fc2`.
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// use weaver_nn::{Builder, Context, Mlp, WeightInit};
/// let mut params = Params::<f32>::new();
/// let mlp = Mlp::new(Builder::new(&mut params, 0).scope("mlp"), 3, 8, 2, WeightInit::FanIn);
/// let tape = Tape::new();
/// let y = mlp.forward(Context::new(&tape, &params), tape.constant(&[0.0; 12], [4, 3]));
/// assert_eq!((y.shape().dims(), params.get(mlp.fc1.weight).name()), (&[4, 2][..], "mlp.fc1.weight"));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Mlp {
    /// The first layer.
    pub fc1: Linear,
    /// The second layer.
    pub fc2: Linear,
}

impl Mlp {
    /// Layers `inputs` -> `hidden` -> `outputs`.
    pub fn new<T: Real>(
        mut builder: Builder<'_, T>,
        inputs: usize,
        hidden: usize,
        outputs: usize,
        init: WeightInit,
    ) -> Self {
        Self {
            fc1: Linear::new(builder.scope("fc1"), inputs, hidden, init),
            fc2: Linear::new(builder.scope("fc2"), hidden, outputs, init),
        }
    }

    /// Applies it to x `[.., in]`, which gives `[.., out]`. Differentiable in x and the parameters.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Var<'t, T> {
        cx.layer(self.fc1.weight, "fc1.weight", || self.fc2.forward(cx, self.fc1.forward_with(cx, x, Activation::Gelu)))
    }
}
