//! Networks from videos to features and scores.

use crate::encoded::Encoded;
use crate::losses::abnormal;
use crate::losses::{bag_loss, deepmil_loss, magnitude_bag_loss, magnitude_loss, smoothness, sparsity};
use crate::score_head::ScoreHead;
use crate::temporal_transformer::UrDmuSizes;
use crate::urdmu::UrDmu;
use weaver_autograd::{Real, Var, ops};
use weaver_kernels::random::Stream;
use weaver_nn::{Builder, Context, Conv1d, Dropout, Linear, WeightInit};

/// Kind of network, with its sizes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EncoderKind {
    /// UR-DMU.
    UrDmu(UrDmuSizes),
    /// Two convolutions along time.
    Convolutions(ConvolutionSizes),
    /// DeepMIL: each snippet by itself.
    DeepMil(DeepMilSizes),
    /// RTFM: convolutions of three dilations and attention; the lengths of features select the snippets of the loss.
    Rtfm(ConvolutionSizes),
}

impl EncoderKind {
    /// Input numbers of each snippet.
    pub fn features(&self) -> usize {
        match self {
            Self::UrDmu(sizes) => sizes.features,
            Self::Convolutions(sizes) | Self::Rtfm(sizes) => sizes.features,
            Self::DeepMil(sizes) => sizes.features,
        }
    }
}

/// Sizes of the networks of convolutions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConvolutionSizes {
    /// Input numbers of each snippet.
    pub features: usize,
    /// Numbers of each snippet within the network.
    pub width: usize,
    /// Classes with a score of their own.
    pub classes: usize,
}

/// Sizes of DeepMIL's network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeepMilSizes {
    /// Input numbers of each snippet.
    pub features: usize,
    /// Hidden numbers of both layers; 512 and 32 as published.
    pub hidden: [usize; 2],
}

/// A network from videos to features and scores.
#[derive(Clone, Debug)]
pub enum Encoder {
    /// UR-DMU.
    UrDmu(UrDmu),
    /// Two convolutions along time.
    Convolutions(Convolutions),
    /// DeepMIL.
    DeepMil(DeepMil),
    /// RTFM.
    Rtfm(Rtfm),
}

impl Encoder {
    /// Builds the network.
    pub fn new<T: Real>(builder: Builder<'_, T>, kind: &EncoderKind) -> Self {
        match kind {
            EncoderKind::UrDmu(sizes) => Self::UrDmu(UrDmu::new(builder, sizes)),
            EncoderKind::Convolutions(sizes) => Self::Convolutions(Convolutions::new(builder, sizes)),
            EncoderKind::DeepMil(sizes) => Self::DeepMil(DeepMil::new(builder, sizes)),
            EncoderKind::Rtfm(sizes) => Self::Rtfm(Rtfm::new(builder, sizes)),
        }
    }

    /// Features and scores of x `[B, T, features]`, as at test time.
    pub fn encode<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Encoded<'t, T> {
        match self {
            Self::UrDmu(network) => network.encode(cx, x),
            Self::Convolutions(network) => network.encode(cx, x),
            Self::DeepMil(network) => network.encode(cx, x, None),
            Self::Rtfm(network) => network.encode(cx, x),
        }
    }

    /// Passes a training batch x `[2 b, T, features]`, normal half first, through the network: its output, and its own
    /// loss, without classes and labels of snippets. Noise and dropout come from the stream.
    pub fn train<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        x: Var<'t, T>,
        stream: Stream,
        dropout: f64,
    ) -> (Encoded<'t, T>, Var<'t, T>) {
        let dropout = Some(Dropout { rate: dropout, stream: stream.fork(0) });
        match self {
            Self::UrDmu(network) => {
                let shape = [x.shape()[0] / 2, x.shape()[1], network.sizes().width];
                let draws = stream.fork(1);
                let noise = cx.tape.constant_with(shape, |noise| {
                    noise.iter_mut().enumerate().for_each(|(i, noise)| *noise = draws.normal(i as u64));
                });
                let pass = network.pass(cx, x, noise, dropout);
                (pass.encoded, bag_loss(pass.encoded.scores) + pass.terms().total())
            }
            Self::Convolutions(network) => {
                let encoded = network.encode(cx, x);
                (encoded, bag_loss(encoded.scores))
            }
            Self::DeepMil(network) => {
                let encoded = network.encode(cx, x, dropout);
                (encoded, deepmil_loss(encoded.scores))
            }
            Self::Rtfm(network) => {
                let encoded = network.encode(cx, x);
                let scores = abnormal(encoded.scores);
                let loss = magnitude_bag_loss(encoded.scores, encoded.features)
                    + magnitude_loss(encoded.features) * 1e-4
                    + smoothness(scores) * 8e-4
                    + sparsity(scores) * 8e-3;
                (encoded, loss)
            }
        }
    }
}

/// `[B, T, 1]` as `[B, T]`.
fn curves<T: Real>(scores: Var<'_, T>) -> Var<'_, T> {
    scores.reshape([scores.shape()[0], scores.shape()[1]])
}

/// Two convolutions of width 3 with ReLU, and a head.
#[derive(Clone, Copy, Debug)]
pub struct Convolutions {
    layers: [Conv1d; 2],
    head: ScoreHead,
    classes: Option<ScoreHead>,
}

impl Convolutions {
    fn new<T: Real>(mut builder: Builder<'_, T>, sizes: &ConvolutionSizes) -> Self {
        let &ConvolutionSizes { features, width, classes } = sizes;
        Self {
            layers: [
                Conv1d::new(builder.scope("conv.0"), features, width, 1),
                Conv1d::new(builder.scope("conv.1"), width, width, 1),
            ],
            head: ScoreHead::new(builder.scope("cls_head.mlp"), width, width / 2, 1),
            classes: (classes > 0).then(|| ScoreHead::new(builder.scope("class_head.mlp"), width, width / 2, classes)),
        }
    }

    fn encode<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Encoded<'t, T> {
        let features = self.layers.iter().fold(x, |x, layer| layer.forward(cx, x).relu());
        Encoded {
            features,
            scores: curves(self.head.forward(cx, features)),
            class_scores: self.classes.map(|head| head.forward(cx, features)),
        }
    }
}

/// Layers D-512-32-1 for each snippet (Sultani et al., arXiv 1801.04264).
#[derive(Clone, Copy, Debug)]
pub struct DeepMil {
    layers: [Linear; 3],
}

impl DeepMil {
    fn new<T: Real>(mut builder: Builder<'_, T>, sizes: &DeepMilSizes) -> Self {
        let [wide, narrow] = sizes.hidden;
        let sizes = [(sizes.features, wide), (wide, narrow), (narrow, 1)];
        let mut layer = 0;
        let layers = sizes.map(|(inputs, outputs)| {
            layer += 1;
            Linear::new(builder.scope(format!("fc{layer}")), inputs, outputs, WeightInit::FanIn)
        });
        Self { layers }
    }

    fn encode<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>, dropout: Option<Dropout>) -> Encoded<'t, T> {
        let [wide, narrow, out] = self.layers;
        let hidden = Dropout::apply(dropout, wide.forward_with(cx, x, ops::Activation::Relu), 0);
        let features = Dropout::apply(dropout, narrow.forward(cx, hidden), 1);
        Encoded { features, scores: curves(out.forward(cx, features).sigmoid()), class_scores: None }
    }
}

/// RTFM's multi-scale temporal network (Tian et al., arXiv 2101.10030): convolutions of dilations 1, 2 and 4 and
/// attention over all snippets, each a quarter of the features, then a convolution whose result is added to them, and
/// layers D-512-128-1 in proportion. Without batch normalization.
#[derive(Clone, Copy, Debug)]
pub struct Rtfm {
    scales: [Conv1d; 3],
    reduce: Linear,
    qkv: Linear,
    fuse: Conv1d,
    layers: [Linear; 3],
}

impl Rtfm {
    fn new<T: Real>(mut builder: Builder<'_, T>, sizes: &ConvolutionSizes) -> Self {
        let &ConvolutionSizes { features, width, .. } = sizes;
        let (quarter, init) = ((features / 4).max(1), WeightInit::FanIn);
        let mut dilation = 1;
        let scales = [0, 1, 2].map(|i| {
            let layer = Conv1d::new(builder.scope(format!("scale.{i}")), features, quarter, dilation);
            dilation *= 2;
            layer
        });
        Self {
            scales,
            reduce: Linear::without_bias(builder.scope("reduce"), features, quarter, init),
            qkv: Linear::new(builder.scope("qkv"), quarter, 3 * quarter, init),
            fuse: Conv1d::new(builder.scope("fuse"), 4 * quarter, features, 1),
            layers: [
                Linear::new(builder.scope("fc1"), features, width, init),
                Linear::new(builder.scope("fc2"), width, (width / 4).max(1), init),
                Linear::new(builder.scope("fc3"), (width / 4).max(1), 1, init),
            ],
        }
    }

    fn encode<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Encoded<'t, T> {
        let scales = self.scales.map(|layer| layer.forward(cx, x).relu());
        let reduced = self.reduce.forward_with(cx, x, ops::Activation::Relu);
        let shape = reduced.shape();
        let parts = ops::split(self.qkv.forward(cx, reduced), 2, &[shape[2]; 3]);
        let [q, k, v] = [0, 1, 2].map(|i| parts[i].reshape([shape[0], shape[1], 1, shape[2]]));
        let attended = reduced + ops::attention(q, k, v, 1.0 / (shape[2] as f64).sqrt()).reshape(shape);
        let all = ops::concat(&[scales[0], scales[1], scales[2], attended], 2);
        let features = self.fuse.forward(cx, all).relu() + x;
        let [wide, narrow, out] = self.layers;
        let hidden = wide.forward_with(cx, features, ops::Activation::Relu);
        let hidden = narrow.forward_with(cx, hidden, ops::Activation::Relu);
        Encoded { features, scores: curves(out.forward(cx, hidden).sigmoid()), class_scores: None }
    }
}
