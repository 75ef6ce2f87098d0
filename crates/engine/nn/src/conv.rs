//! Convolution layers.

use crate::{Builder, Context, WeightInit};
use weaver_autograd::{ParamId, Real, Var, ops};

/// Two-dimensional convolution ([`ops::conv2d`]); parameters `weight` `[out, in, k, k]` and `bias` `[out]`.
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// use weaver_nn::{Builder, Context, Conv2d, WeightInit};
/// let mut params = Params::<f32>::new();
/// let layer = Conv2d::new(Builder::new(&mut params, 0).scope("patch"), 3, 5, 2, WeightInit::FanIn);
/// let layer = layer.with_stride(2).with_padding(0);
/// let tape = Tape::new();
/// let y = layer.forward(Context::new(&tape, &params), tape.constant(&[0.0; 72], [1, 3, 4, 6]));
/// assert_eq!(y.shape().dims(), [1, 5, 2, 3]);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Conv2d {
    /// `weight`, `[out, in, k, k]`.
    pub weight: ParamId,
    /// `bias`, `[out]`, if there is one.
    pub bias: Option<ParamId>,
    /// Step between windows, both ways; 1 unless changed.
    pub stride: usize,
    /// Zeros around the image; unless changed half the kernel, which keeps the size of an image at stride 1.
    pub padding: usize,
}

impl Conv2d {
    /// A square kernel from `inputs` to `outputs` channels at stride 1, padded by half the kernel.
    pub fn new<T: Real>(
        mut builder: Builder<'_, T>,
        inputs: usize,
        outputs: usize,
        kernel: usize,
        init: WeightInit,
    ) -> Self {
        let (weights, biases) = init.of(inputs * kernel * kernel);
        let weight = builder.add("weight", [outputs, inputs, kernel, kernel], weights);
        Self { weight, bias: Some(builder.add("bias", [outputs], biases)), stride: 1, padding: kernel / 2 }
    }

    /// A square kernel from `inputs` to `outputs` channels at stride 1, padded by half the kernel, that adds no bias.
    pub fn without_bias<T: Real>(
        mut builder: Builder<'_, T>,
        inputs: usize,
        outputs: usize,
        kernel: usize,
        init: WeightInit,
    ) -> Self {
        let weights = init.of(inputs * kernel * kernel).0;
        let weight = builder.add("weight", [outputs, inputs, kernel, kernel], weights);
        Self { weight, bias: None, stride: 1, padding: kernel / 2 }
    }

    /// This layer with another stride.
    pub fn with_stride(self, stride: usize) -> Self {
        Self { stride, ..self }
    }

    /// This layer with another padding.
    pub fn with_padding(self, padding: usize) -> Self {
        Self { padding, ..self }
    }

    /// Applies it to x `[N, in, H, W]`, which gives `[N, out, H', W']` with H' = (H + 2 padding - k) / stride + 1,
    /// rounded down. Differentiable in x and the parameters.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Var<'t, T> {
        cx.layer(self.weight, "weight", || {
            ops::conv2d(x, cx.param(self.weight), self.bias.map(|b| cx.param(b)), self.stride, self.padding)
        })
    }
}

/// Transposed convolution whose stride is its kernel, which enlarges maps by that factor; parameters `weight`
/// `[in, out, k, k]` and `bias` `[out]`.
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// use weaver_nn::{Builder, Context, ConvTranspose2d, WeightInit};
/// let mut params = Params::<f32>::new();
/// let layer = ConvTranspose2d::new(Builder::new(&mut params, 0).scope("up"), 3, 5, 2, WeightInit::FanIn);
/// let tape = Tape::new();
/// let y = layer.forward(Context::new(&tape, &params), tape.constant(&[0.0; 6], [1, 3, 1, 2]));
/// assert_eq!(y.shape().dims(), [1, 5, 2, 4]);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ConvTranspose2d {
    /// `weight`, `[in, out, k, k]`.
    pub weight: ParamId,
    /// `bias`, `[out]`.
    pub bias: ParamId,
    /// The kernel's side, and the step between its copies.
    pub stride: usize,
}

impl ConvTranspose2d {
    /// A layer from `inputs` to `outputs` channels that enlarges by `factor`.
    pub fn new<T: Real>(
        mut builder: Builder<'_, T>,
        inputs: usize,
        outputs: usize,
        factor: usize,
        init: WeightInit,
    ) -> Self {
        // PyTorch's fan in here: the second dimension of the weight times the kernel.
        let (weights, biases) = init.of(outputs * factor * factor);
        let weight = builder.add("weight", [inputs, outputs, factor, factor], weights);
        Self { weight, bias: builder.add("bias", [outputs], biases), stride: factor }
    }

    /// Applies it to x `[N, in, H, W]`, which gives `[N, out, factor H, factor W]`. Differentiable in x and the
    /// parameters.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Var<'t, T> {
        cx.layer(self.weight, "weight", || {
            ops::conv_transpose2d(x, cx.param(self.weight), Some(cx.param(self.bias)), self.stride)
        })
    }
}
