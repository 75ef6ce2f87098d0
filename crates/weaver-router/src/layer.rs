//! A fully connected layer with PyTorch's default initial values.

use weaver_autograd::ops::{self, Activation};
use weaver_autograd::{ParamId, Real, Shape, Var};
use weaver_nn::{Builder, Context, Init};

/// x W^T + b with parameters `weight` and `bias`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layer {
    pub weight: ParamId,
    pub bias: ParamId,
}

impl Layer {
    /// A layer from `inputs` to `outputs` numbers.
    pub fn new<T: Real>(
        builder: &mut Builder<'_, T>,
        name: impl std::fmt::Display,
        inputs: usize,
        outputs: usize,
    ) -> Self {
        Self::with_shape(builder, name, [outputs, inputs].into())
    }

    /// The same under the name and shape of a 1 x 1 convolution.
    pub fn convolution<T: Real>(
        builder: &mut Builder<'_, T>,
        name: impl std::fmt::Display,
        inputs: usize,
        outputs: usize,
    ) -> Self {
        Self::with_shape(builder, name, [outputs, inputs, 1, 1].into())
    }

    fn with_shape<T: Real>(builder: &mut Builder<'_, T>, name: impl std::fmt::Display, shape: Shape) -> Self {
        let mut builder = builder.scope(name);
        let init = Init::fan_in(shape[1]);
        Self { weight: builder.add("weight", shape, init), bias: builder.add("bias", [shape[0]], init) }
    }

    /// Multiplies the initial weights and biases by a factor.
    pub fn scale<T: Real>(&self, builder: &mut Builder<'_, T>, factor: f64) {
        for id in [self.weight, self.bias] {
            builder.value_mut(id).iter_mut().for_each(|w| *w = *w * T::from_f64(factor));
        }
    }

    /// Applies it to rows [N, inputs].
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, T>, x: Var<'t, T>, activation: Activation) -> Var<'t, T> {
        let weight = cx.param(self.weight);
        let matrix = weight.reshape([weight.shape()[0], weight.shape()[1]]);
        ops::linear(x, matrix, Some(cx.param(self.bias)), activation)
    }
}

/// Two layers with a rectifier between them, named 0 and 2.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TwoLayers {
    pub hidden: Layer,
    pub output: Layer,
}

impl TwoLayers {
    /// Fully connected layers `inputs` -> `hidden` -> `outputs`.
    pub fn new<T: Real>(builder: &mut Builder<'_, T>, inputs: usize, hidden: usize, outputs: usize) -> Self {
        Self { hidden: Layer::new(builder, 0, inputs, hidden), output: Layer::new(builder, 2, hidden, outputs) }
    }

    /// Applies them to rows [N, inputs].
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, T>, x: Var<'t, T>) -> Var<'t, T> {
        let hidden = self.hidden.forward(cx, x, Activation::Relu);
        self.output.forward(cx, hidden, Activation::None)
    }
}
