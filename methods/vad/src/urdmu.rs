//! UR-DMU: dual memory units with uncertainty regulation (Zhou et al., arXiv 2302.05160), as its public code computes.

use crate::encoded::Encoded;
use crate::memory::{Memory, Recalled};
use crate::score_head::ScoreHead;
use crate::temporal_transformer::{TemporalTransformer, UrDmuSizes};
use crate::top_k::top_k;
use weaver_autograd::ops::{self, binary_cross_entropy, mean_at_top_k, top_k_mean};
use weaver_autograd::{Real, Var};
use weaver_nn::{Builder, Context, Dropout, Linear, WeightInit};

/// The network. Parameters have the names of the public weights.
#[derive(Clone, Debug)]
pub struct UrDmu {
    sizes: UrDmuSizes,
    snippets: TemporalTransformer,
    anomalous: Memory,
    normal: Memory,
    mean: Linear,
    variance: Linear,
    head: ScoreHead,
    classes: Option<ScoreHead>,
}

/// A training batch passed through the network.
#[derive(Clone, Copy, Debug)]
pub struct UrDmuPass<'t, T: Real = f32> {
    /// Task-aware features and scores.
    pub encoded: Encoded<'t, T>,
    /// The extractor's features, `[2 b, T, width]`.
    pub snippets: Var<'t, T>,
    /// Attention of the anomalous memory on abnormal videos, `[b, T]`.
    pub anomalous_on_abnormal: Var<'t, T>,
    /// Attention of the normal memory on abnormal videos.
    pub normal_on_abnormal: Var<'t, T>,
    /// Attention of the anomalous memory on normal videos.
    pub anomalous_on_normal: Var<'t, T>,
    /// Attention of the normal memory on normal videos.
    pub normal_on_normal: Var<'t, T>,
    /// Mean and logarithm of the variance of the normal memory's answer to normal videos, `[b, T, width]`.
    latent: (Var<'t, T>, Var<'t, T>),
    /// A sample of the latent distribution.
    drawn: Var<'t, T>,
    /// The mean of the anomalous memory's answer to abnormal videos.
    anomalous_mean: Var<'t, T>,
}

/// The terms of UR-DMU's loss beside the loss of scores, each a scalar without its weight.
#[derive(Clone, Copy, Debug)]
pub struct UrDmuTerms<'t, T: Real = f32> {
    /// Raises the anomalous memory's attention to the most anomalous snippets of abnormal videos.
    pub anomalous_on_abnormal: Var<'t, T>,
    /// Lowers the normal memory's attention to the least normal snippets of abnormal videos.
    pub normal_on_abnormal: Var<'t, T>,
    /// Raises the normal memory's attention to normal videos.
    pub normal_on_normal: Var<'t, T>,
    /// Lowers the anomalous memory's attention to normal videos.
    pub anomalous_on_normal: Var<'t, T>,
    /// Normal snippets of both kinds of videos are closer to each other than to anomalous ones.
    pub triplet: Var<'t, T>,
    /// Divergence of the latent distribution of normal snippets from the standard normal one.
    pub divergence: Var<'t, T>,
    /// Anomalous latents are longer than normal ones, by 100.
    pub distance: Var<'t, T>,
}

impl<'t, T: Real> UrDmuTerms<'t, T> {
    /// The weighted sum, as published.
    pub fn total(&self) -> Var<'t, T> {
        let memories = self.anomalous_on_abnormal + self.normal_on_abnormal + self.normal_on_normal;
        (memories + self.anomalous_on_normal) * 0.1
            + self.triplet * 0.1
            + self.divergence * 0.001
            + self.distance * 0.0001
    }
}

impl UrDmu {
    /// Builds the network.
    pub fn new<T: Real>(mut builder: Builder<'_, T>, sizes: &UrDmuSizes) -> Self {
        let UrDmuSizes { width, memory, score_hidden, classes, .. } = *sizes;
        let (latent, init) = (sizes.task_aware(), WeightInit::FanIn);
        Self {
            sizes: *sizes,
            snippets: TemporalTransformer::new(builder.scope_here(), sizes),
            anomalous: Memory::new(builder.scope("Amemory"), memory, width),
            normal: Memory::new(builder.scope("Nmemory"), memory, width),
            mean: Linear::new(builder.scope("encoder_mu.0"), width, width, init),
            variance: Linear::new(builder.scope("encoder_var.0"), width, width, init),
            head: ScoreHead::new(builder.scope("cls_head.mlp"), latent, score_hidden, 1),
            classes: (classes > 0)
                .then(|| ScoreHead::new(builder.scope("class_head.mlp"), latent, score_hidden, classes)),
        }
    }

    /// Its sizes.
    pub fn sizes(&self) -> &UrDmuSizes {
        &self.sizes
    }

    /// Task-aware features and scores of unlabeled videos, x `[B, T, features]`: z = [x ; mu(A x) + mu(N x)], where A
    /// and N are the answers of the memories to x.
    pub fn encode<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Encoded<'t, T> {
        let x = self.snippets.forward(cx, x, None);
        let recall = |memory: &Memory| self.mean.forward(cx, memory.recall(cx, x).augmented);
        self.judge(cx, ops::concat(&[x, recall(&self.anomalous) + recall(&self.normal)], 2))
    }

    fn judge<'t, T: Real>(&self, cx: Context<'t, '_, T>, features: Var<'t, T>) -> Encoded<'t, T> {
        let scores = self.head.forward(cx, features);
        let shape = scores.shape();
        Encoded {
            features,
            scores: scores.reshape([shape[0], shape[1]]),
            class_scores: self.classes.map(|head| head.forward(cx, features)),
        }
    }

    /// Passes a training batch, x `[2 b, T, features]` with its normal half first, through the network. `noise`
    /// `[b, T, width]` is standard normal and constant.
    pub fn pass<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        x: Var<'t, T>,
        noise: Var<'t, T>,
        dropout: Option<Dropout>,
    ) -> UrDmuPass<'t, T> {
        let x = self.snippets.forward(cx, x, dropout);
        let half = x.shape()[0] / 2;
        let (n, a) = (x.slice(0, 0, half), x.slice(0, half, half));
        let recall = |memory: &Memory, x| -> Recalled<'t, T> { memory.recall(cx, x) };
        let mean = |recalled: &Recalled<'t, T>| self.mean.forward(cx, recalled.augmented);
        let (a_a, n_a) = (recall(&self.anomalous, a), recall(&self.normal, a));
        let (a_n, n_n) = (recall(&self.anomalous, n), recall(&self.normal, n));
        let latent = (mean(&n_n), self.variance.forward(cx, n_n.augmented));
        let drawn = latent.0 + noise * (latent.1 * 0.5).exp();
        let anomalous_mean = mean(&a_a);
        let augmented = ops::concat(&[drawn + mean(&a_n), anomalous_mean + mean(&n_a)], 0);
        UrDmuPass {
            encoded: self.judge(cx, ops::concat(&[x, augmented], 2)),
            snippets: x,
            anomalous_on_abnormal: a_a.attention,
            normal_on_abnormal: n_a.attention,
            anomalous_on_normal: a_n.attention,
            normal_on_normal: n_n.attention,
            latent,
            drawn,
            anomalous_mean,
        }
    }
}

impl<'t, T: Real> UrDmuPass<'t, T> {
    /// The terms of the loss beside the loss of scores.
    pub fn terms(&self) -> UrDmuTerms<'t, T> {
        let (tape, x) = (self.snippets.tape(), self.snippets);
        let (half, k) = (x.shape()[0] / 2, top_k(x.shape()[1]));
        let against =
            |p: Var<'t, T>, y: T| binary_cross_entropy(p, tape.constant_with(p.shape(), |target| target.fill(y)));
        let (n, a) = (x.slice(0, 0, half), x.slice(0, half, half));
        let unit = |x, by| mean_at_top_k(x, by, k).normalize_rows(0.0);
        let [anchor, positive, negative] =
            [unit(n, self.normal_on_normal), unit(a, self.normal_on_abnormal), unit(a, self.anomalous_on_abnormal)];
        // PyTorch's pairwise distance adds this epsilon to each difference.
        let apart = |p: Var<'t, T>, q: Var<'t, T>| length(p - q + 1e-6);
        let (mean, variance) = self.latent;
        let divergence = (variance - mean.square() - variance.exp() + 1.0).sum_axis(1) * -0.5;
        let normal = length(mean_at_top_k(self.drawn, self.normal_on_normal, k));
        let anomalous = length(mean_at_top_k(self.anomalous_mean, self.anomalous_on_abnormal, k));
        UrDmuTerms {
            anomalous_on_abnormal: against(top_k_mean(self.anomalous_on_abnormal, k), T::ONE),
            normal_on_abnormal: against(top_k_mean(-self.normal_on_abnormal + 1.0, k), T::ONE),
            normal_on_normal: against(self.normal_on_normal, T::ONE),
            anomalous_on_normal: against(self.anomalous_on_normal, T::ZERO),
            triplet: (apart(anchor, positive) - apart(anchor, negative) + 1.0).relu().mean(),
            divergence: divergence.mean(),
            distance: (normal - anomalous + 100.0).relu().mean(),
        }
    }
}

/// The lengths of rows.
pub(crate) fn length<T: Real>(x: Var<'_, T>) -> Var<'_, T> {
    x.square().sum_axis(x.shape().rank() - 1).sqrt()
}
