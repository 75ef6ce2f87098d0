//! Learned perceptual image patch similarity (LPIPS): the distance of two images in the features of a classifier.

use super::feature_distance::feature_distance;
use super::max_pool2d;
use crate::metrics::PerceptualDistance;
use std::collections::BTreeMap;
use std::sync::Arc;
use weaver_autograd::ops::conv2d;
use weaver_autograd::{Real, Tape, Var};

/// Tensors by name, each with its shape and its numbers.
pub type Tensors = BTreeMap<String, (Vec<usize>, Vec<f32>)>;

/// Mean and deviation by which the published weights normalize each channel of an image in `[-1, 1]`.
const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f32; 3] = [0.458, 0.448, 0.450];

/// The network whose features are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Network {
    /// AlexNet: fast, and closest to human judgment.
    Alex,
    /// VGG16: the usual choice as a loss.
    Vgg,
}

/// A convolution followed by a ReLU. Its name is its index in torchvision's `features`.
struct Convolution {
    index: usize,
    /// Output channels, input channels, and the kernel's width.
    shape: [usize; 3],
    stride: usize,
    padding: usize,
}

/// The layers between one compared feature map and the next.
struct Stage {
    /// Window and stride of the max-pooling in front.
    pool: Option<[usize; 2]>,
    convolutions: &'static [Convolution],
}

const fn conv(index: usize, shape: [usize; 3]) -> Convolution {
    Convolution { index, shape, stride: 1, padding: shape[2] / 2 }
}

const ALEX: [Stage; 5] = [
    Stage { pool: None, convolutions: &[Convolution { index: 0, shape: [64, 3, 11], stride: 4, padding: 2 }] },
    Stage { pool: Some([3, 2]), convolutions: &[conv(3, [192, 64, 5])] },
    Stage { pool: Some([3, 2]), convolutions: &[conv(6, [384, 192, 3])] },
    Stage { pool: None, convolutions: &[conv(8, [256, 384, 3])] },
    Stage { pool: None, convolutions: &[conv(10, [256, 256, 3])] },
];

const VGG: [Stage; 5] = [
    Stage { pool: None, convolutions: &[conv(0, [64, 3, 3]), conv(2, [64, 64, 3])] },
    Stage { pool: Some([2, 2]), convolutions: &[conv(5, [128, 64, 3]), conv(7, [128, 128, 3])] },
    Stage {
        pool: Some([2, 2]),
        convolutions: &[conv(10, [256, 128, 3]), conv(12, [256, 256, 3]), conv(14, [256, 256, 3])],
    },
    Stage {
        pool: Some([2, 2]),
        convolutions: &[conv(17, [512, 256, 3]), conv(19, [512, 512, 3]), conv(21, [512, 512, 3])],
    },
    Stage {
        pool: Some([2, 2]),
        convolutions: &[conv(24, [512, 512, 3]), conv(26, [512, 512, 3]), conv(28, [512, 512, 3])],
    },
];

impl Network {
    fn stages(self) -> &'static [Stage; 5] {
        match self {
            Self::Alex => &ALEX,
            Self::Vgg => &VGG,
        }
    }

    fn least_side(self) -> usize {
        match self {
            Self::Alex => 31,
            Self::Vgg => 16,
        }
    }
}

/// Weights that do not fit the network.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}: `{key}`: expected a tensor of shape {expected:?}, found {}", match found {
    Some(shape) => format!("one of shape {shape:?}"),
    None => "none".to_owned(),
})]
pub struct LpipsError {
    /// Source of the tensors.
    pub file: String,
    /// The tensor's name.
    pub key: String,
    /// The shape that the network has.
    pub expected: Vec<usize>,
    /// The shape that the file has, if any.
    pub found: Option<Vec<usize>>,
}

/// A constant tensor, put on any tape without a copy.
#[derive(Debug)]
pub(crate) struct Weight<T> {
    shape: Vec<usize>,
    data: Arc<Vec<T>>,
}

impl<T: Real> Weight<T> {
    pub fn new(shape: &[usize], data: Vec<T>) -> Self {
        Self { shape: shape.to_vec(), data: Arc::new(data) }
    }

    pub fn on<'t>(&self, tape: &'t Tape<T>) -> Var<'t, T> {
        tape.shared_constant(&self.data, &self.shape[..])
    }
}

/// A tensor of an expected shape; `file` names the origin of all.
pub(crate) fn take<T: Real>(
    tensors: &Tensors,
    file: &str,
    key: String,
    expected: &[usize],
) -> Result<Weight<T>, LpipsError> {
    let found = tensors.get(&key);
    match found {
        Some((shape, data)) if shape == expected && data.len() == expected.iter().product() => {
            Ok(Weight::new(expected, data.iter().map(|x| T::from_f32(*x)).collect()))
        }
        _ => Err(LpipsError {
            file: file.to_owned(),
            key,
            expected: expected.to_vec(),
            found: found.map(|(shape, _)| shape.clone()),
        }),
    }
}

/// The perceptual distance of Zhang et al., version 0.1, with fixed weights.
#[derive(Debug)]
pub struct Lpips<T: Real = f32> {
    network: Network,
    /// Weight and bias of the 1x1 convolution that brings images in [0, 1] to the range that the network was trained
    /// on.
    scaling: [Weight<T>; 2],
    /// Weight and bias of every convolution, in order.
    convolutions: Vec<[Weight<T>; 2]>,
    /// Weights of the channels of the five feature maps.
    channels: Vec<Weight<T>>,
}

impl<T: Real> Lpips<T> {
    /// Takes the network's weights from named tensors: `net.slice{1..5}.{index}.weight` and `.bias`,
    /// `lin{0..4}.model.1.weight`, as the lpips package names them. `file` names their origin in
    /// errors.
    pub fn from_tensors(network: Network, tensors: &Tensors, file: &str) -> Result<Self, LpipsError> {
        let take = |key: String, expected: &[usize]| take(tensors, file, key, expected);
        let (mut convolutions, mut channels) = (Vec::new(), Vec::new());
        for (i, stage) in network.stages().iter().enumerate() {
            let mut features = 0;
            for Convolution { index, shape: [outputs, inputs, width], .. } in stage.convolutions {
                let name = format!("net.slice{}.{index}", i + 1);
                let weight = take(format!("{name}.weight"), &[*outputs, *inputs, *width, *width])?;
                convolutions.push([weight, take(format!("{name}.bias"), &[*outputs])?]);
                features = *outputs;
            }
            channels.push(take(format!("lin{i}.model.1.weight"), &[1, features, 1, 1])?);
        }
        // ((2 x - 1) - shift) / scale as one affine map of each channel.
        let [shift, scale] = [SHIFT, SCALE].map(|c| c.map(f64::from));
        let diagonal = |i: usize| if i.is_multiple_of(4) { 2.0 / scale[i / 4] } else { 0.0 };
        let scaling = [
            Weight::new(&[3, 3, 1, 1], (0..9).map(|i| T::from_f64(diagonal(i))).collect()),
            Weight::new(&[3], (0..3).map(|c| T::from_f64((-1.0 - shift[c]) / scale[c])).collect()),
        ];
        Ok(Self { network, scaling, convolutions, channels })
    }

    /// The smallest side of an image that the network's pooling leaves something of, pixels.
    pub fn least_side(&self) -> usize {
        self.network.least_side()
    }

    /// The perceptual distance of each pair of images: 0 for equal ones.
    ///
    /// It is the sum over five layers l of the mean over pixels of sum_c w_lc (f_lc(a)/|f_l(a)| - f_lc(b)/|f_l(b)|)^2.
    /// Images `[N, 3, H, W]` with values in [0, 1] give `[N]`. Differentiable in both images, with gradient 0 where all
    /// features of a pixel vanish; the weights are constants. Panics when a side of the images is below
    /// [`least_side`](Self::least_side). Source: Zhang et al., The unreasonable effectiveness of deep features as a
    /// perceptual metric, 2018.
    #[track_caller]
    pub fn distance<'t>(&self, a: Var<'t, T>, b: Var<'t, T>) -> Var<'t, T> {
        let [first, rest @ ..] = self.layers(a, b);
        rest.into_iter().fold(first, |sum, term| sum + term)
    }

    /// The five layers' terms of [`distance`](Self::distance), each `[N]`.
    #[track_caller]
    pub fn layers<'t>(&self, a: Var<'t, T>, b: Var<'t, T>) -> [Var<'t, T>; 5] {
        let tape = a.tape();
        tape.part("lpips", || {
            let [a, b] = [a, b].map(|image| self.features(image));
            std::array::from_fn(|i| feature_distance(a[i], b[i], self.channels[i].on(tape)))
        })
    }

    fn features<'t>(&self, image: Var<'t, T>) -> [Var<'t, T>; 5] {
        let tape = image.tape();
        let [weight, bias] = &self.scaling;
        let mut x = conv2d(image, weight.on(tape), Some(bias.on(tape)), 1, 0);
        let mut weights = self.convolutions.iter();
        self.network.stages().each_ref().map(|stage| {
            if let Some([size, stride]) = stage.pool {
                x = max_pool2d(x, size, stride);
            }
            for (layer, [weight, bias]) in stage.convolutions.iter().zip(&mut weights) {
                x = conv2d(x, weight.on(tape), Some(bias.on(tape)), layer.stride, layer.padding).relu();
            }
            x
        })
    }
}

impl<T: Real> PerceptualDistance<T> for Lpips<T> {
    fn least_side(&self) -> usize {
        self.least_side()
    }

    fn between(&self, a: &[T], b: &[T], size: [usize; 2]) -> f64 {
        let tape = Tape::new();
        let [a, b] = [a, b].map(|image| tape.constant(image, [1, 3, size[0], size[1]]));
        self.distance(a, b).item().to_f64()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The side of the last feature map of images with this side, if there is one.
    fn last_side(network: Network, side: usize) -> Option<usize> {
        let slide = |side: usize, window: usize, stride: usize| Some(side.checked_sub(window)? / stride + 1);
        network.stages().iter().try_fold(side, |side, stage| {
            let pooled = stage.pool.map_or(Some(side), |[window, stride]| slide(side, window, stride))?;
            stage.convolutions.iter().try_fold(pooled, |side, c| slide(side + 2 * c.padding, c.shape[2], c.stride))
        })
    }

    #[test]
    fn the_least_side_leaves_a_pixel() {
        for network in [Network::Alex, Network::Vgg] {
            let least = network.least_side();
            assert_eq!((last_side(network, least), last_side(network, least - 1)), (Some(1), None), "{network:?}");
        }
    }
}
