//! The perceptual loss of images by the features of VGG-19: absolute differences, layer by layer.

use super::lpips::{LpipsError, Tensors, Weight, take};
use weaver_autograd::ops::conv2d;
use weaver_autograd::{Real, Var};

/// Mean color of the photos that MatConvNet's weights were trained on, red, green and blue of 255.
const MEAN: [f64; 3] = [123.68, 116.779, 103.939];

/// Weights of the mean absolute differences of pixels and of five layers, before they are divided by 255.
const SHARES: [f64; 6] = [1.0, 1.0 / 2.6, 1.0 / 4.8, 1.0 / 3.7, 1.0 / 5.6, 10.0 / 1.5];

/// The convolutions between one compared layer and the next: index in torchvision's `features`, outputs, inputs. A
/// pooling stands before [`POOLED`].
const LAYERS: [&[[usize; 3]]; 5] = [
    &[[0, 64, 3], [2, 64, 64]],
    &[[5, 128, 64], [7, 128, 128]],
    &[[10, 256, 128], [12, 256, 256]],
    &[[14, 256, 256], [16, 256, 256], [19, 512, 256], [21, 512, 512]],
    &[[23, 512, 512], [25, 512, 512], [28, 512, 512], [30, 512, 512]],
];
const POOLED: [usize; 4] = [5, 10, 19, 28];

/// The perceptual loss of Chen and Koltun as 2Xplat trains with it, with fixed weights.
///
/// `loss = (e0 + e1 / 2.6 + e2 / 4.8 + e3 / 3.7 + e4 / 5.6 + 10 e5 / 1.5) / 255`
///
/// where e0 is the mean absolute difference of the pixels `255 x - mean` and e1 to e5 are mean absolute differences of
/// the rectified second convolutions of the five blocks of VGG-19, whose pooling takes means of 2 x 2. Source: Chen and
/// Koltun, Photographic image synthesis with cascaded refinement networks, 2017; 2Xplat, arXiv 2603.21064.
#[derive(Debug)]
pub struct Perceptual<T: Real = f32> {
    /// Weight and bias of the 1x1 convolution that brings images in [0, 1] to the range that the network was trained
    /// on.
    scaling: [Weight<T>; 2],
    /// Weight and bias of every convolution, layer by layer.
    layers: [Vec<[Weight<T>; 2]>; 5],
}

impl<T: Real> Perceptual<T> {
    /// The smallest side of an image that four poolings leave something of, pixels.
    pub const LEAST_SIDE: usize = 16;

    /// Takes MatConvNet's weights from tensors with torchvision's names, `features.{0, 2, 5, ..., 30}.weight` and
    /// `.bias`. `file` names their origin in errors.
    ///
    /// # Errors
    /// Names the first tensor that is missing or of another shape.
    pub fn from_tensors(tensors: &Tensors, file: &str) -> Result<Self, LpipsError> {
        let convolution = |[index, outputs, inputs]: &[usize; 3]| {
            let weight = take(tensors, file, format!("features.{index}.weight"), &[*outputs, *inputs, 3, 3])?;
            Ok([weight, take(tensors, file, format!("features.{index}.bias"), &[*outputs])?])
        };
        let [a, b, c, d, e] = LAYERS.map(|layer| layer.iter().map(convolution).collect::<Result<Vec<_>, LpipsError>>());
        let diagonal = |i: usize| if i.is_multiple_of(4) { 255.0 } else { 0.0 };
        let scaling = [
            Weight::new(&[3, 3, 1, 1], (0..9).map(|i| T::from_f64(diagonal(i))).collect()),
            Weight::new(&[3], MEAN.iter().map(|mean| T::from_f64(-mean)).collect()),
        ];
        Ok(Self { scaling, layers: [a?, b?, c?, d?, e?] })
    }

    /// The loss of images `[N, 3, H, W]` with values in [0, 1] against others: a scalar, 0 for equal ones.
    /// Differentiable in both; the weights are constants. Panics when shapes differ or a side is below
    /// [`LEAST_SIDE`](Self::LEAST_SIDE).
    #[track_caller]
    pub fn loss<'t>(&self, a: Var<'t, T>, b: Var<'t, T>) -> Var<'t, T> {
        assert_eq!(a.shape(), b.shape(), "perceptual loss: expected images of one shape");
        a.tape().part("perceptual", || {
            let [mut a, mut b] = [a, b].map(|image| convolved(image, &self.scaling, 0));
            let mut sum = apart(a, b) * SHARES[0];
            for ((layer, places), share) in self.layers.iter().zip(LAYERS).zip(&SHARES[1..]) {
                for (weights, [index, ..]) in layer.iter().zip(places) {
                    [a, b] = [a, b].map(|x| {
                        let x = if POOLED.contains(index) { mean_pooled(x) } else { x };
                        convolved(x, weights, 1).relu()
                    });
                }
                sum = sum + apart(a, b) * *share;
            }
            sum * (1.0 / 255.0)
        })
    }
}

fn convolved<'t, T: Real>(x: Var<'t, T>, [weight, bias]: &[Weight<T>; 2], padding: usize) -> Var<'t, T> {
    conv2d(x, weight.on(x.tape()), Some(bias.on(x.tape())), 1, padding)
}

fn apart<'t, T: Real>(a: Var<'t, T>, b: Var<'t, T>) -> Var<'t, T> {
    (a - b).abs().mean()
}

/// Means of 2 x 2; an odd last row or column is left out.
fn mean_pooled<T: Real>(x: Var<'_, T>) -> Var<'_, T> {
    let [n, c, h, w] = [0, 1, 2, 3].map(|axis| x.shape()[axis]);
    let even = x.slice(2, 0, h / 2 * 2).slice(3, 0, w / 2 * 2);
    even.reshape([n * c, h / 2, 2, w / 2, 2]).mean_axis(4).mean_axis(2).reshape([n, c, h / 2, w / 2])
}
