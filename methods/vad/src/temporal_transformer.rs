//! UR-DMU's feature extractor: a convolution along time and layers of global and local attention.

use crate::decay_attention::decay_attention;
use weaver_autograd::{Real, Var, ops};
use weaver_nn::{Builder, Context, Conv1d, Dropout, LayerNorm, Linear, WeightInit};

/// Sizes of the network of UR-DMU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UrDmuSizes {
    /// Input numbers of each snippet.
    pub features: usize,
    /// Numbers of each snippet within the network.
    pub width: usize,
    /// Transformer layers.
    pub layers: usize,
    /// Attention heads of a layer.
    pub heads: usize,
    /// Numbers of a head.
    pub head: usize,
    /// Hidden numbers of a layer's second half.
    pub hidden: usize,
    /// Entries of each memory.
    pub memory: usize,
    /// Hidden numbers of the scores' head.
    pub score_hidden: usize,
    /// Classes with a score of their own; none in the published network.
    pub classes: usize,
}

impl UrDmuSizes {
    /// The published sizes, for features of this width.
    pub fn published(features: usize) -> Self {
        let (layers, heads, head, memory) = (2, 4, 128, 60);
        Self { features, width: 512, layers, heads, head, hidden: 512, memory, score_hidden: 128, classes: 0 }
    }

    /// Sizes for a few hundred short videos.
    pub fn small(features: usize) -> Self {
        let (layers, heads, head, memory) = (2, 4, 8, 12);
        Self { features, width: 32, layers, heads, head, hidden: 32, memory, score_hidden: 16, classes: 0 }
    }

    /// Numbers of the task-aware features.
    pub fn task_aware(&self) -> usize {
        2 * self.width
    }
}

/// A transformer layer that attends by content and, beside it, by distance in time.
#[derive(Clone, Copy, Debug)]
struct Layer {
    norm1: LayerNorm,
    to_qkv: Linear,
    to_out: Linear,
    norm2: LayerNorm,
    linear1: Linear,
    linear2: Linear,
    heads: usize,
}

impl Layer {
    fn new<T: Real>(mut builder: Builder<'_, T>, sizes: &UrDmuSizes) -> Self {
        let (width, inner, init) = (sizes.width, sizes.heads * sizes.head, WeightInit::FanIn);
        // The names of the public weights.
        Self {
            norm1: LayerNorm::new(builder.scope("0.norm"), width, 1e-5),
            to_qkv: Linear::without_bias(builder.scope("0.fn.to_qkv"), width, 4 * inner, init),
            to_out: Linear::new(builder.scope("0.fn.to_out.0"), 2 * inner, width, init),
            norm2: LayerNorm::new(builder.scope("1.norm"), width, 1e-5),
            linear1: Linear::new(builder.scope("1.fn.net.0"), width, sizes.hidden, init),
            linear2: Linear::new(builder.scope("1.fn.net.3"), sizes.hidden, width, init),
            heads: sizes.heads,
        }
    }

    fn attend<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Var<'t, T> {
        let (batch, time) = (x.shape()[0], x.shape()[1]);
        let mixed = self.to_qkv.forward(cx, self.norm1.forward(cx, x));
        let inner = mixed.shape().last() / 4;
        let parts = ops::split(mixed, 2, &[inner; 4]);
        let by_head = [batch, time, self.heads, inner / self.heads];
        let [q, k, v] = [0, 1, 2].map(|i| parts[i].reshape(by_head));
        let global = ops::attention(q, k, v, 1.0 / (by_head[3] as f64).sqrt());
        let local = decay_attention(parts[3]).reshape(by_head);
        self.to_out.forward(cx, ops::concat(&[global, local], 3).reshape([batch, time, 2 * inner]))
    }

    fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        x: Var<'t, T>,
        dropout: Option<Dropout>,
        place: u64,
    ) -> Var<'t, T> {
        let drop = |x, i| Dropout::apply(dropout, x, 3 * place + i);
        let attend = || x + drop(self.attend(cx, x), 0);
        let transform = |x: Var<'t, T>| {
            let hidden = self.linear1.forward_with(cx, self.norm2.forward(cx, x), ops::Activation::Gelu);
            x + drop(self.linear2.forward(cx, drop(hidden, 1)), 2)
        };
        cx.tape.steps(attend).then(transform).end()
    }
}

/// The features of snippets in their temporal context.
#[derive(Clone, Debug)]
pub(crate) struct TemporalTransformer {
    embedding: Conv1d,
    layers: Vec<Layer>,
}

impl TemporalTransformer {
    pub fn new<T: Real>(mut builder: Builder<'_, T>, sizes: &UrDmuSizes) -> Self {
        let embedding = Conv1d::new(builder.scope("embedding.conv_1.0"), sizes.features, sizes.width, 1);
        let layers = (0..sizes.layers).map(|i| Layer::new(builder.scope(format!("selfatt.layers.{i}")), sizes));
        Self { embedding, layers: layers.collect() }
    }

    /// x `[B, T, features]` gives `[B, T, width]`.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>, dropout: Option<Dropout>) -> Var<'t, T> {
        let embed = || self.embedding.forward(cx, x).relu();
        cx.tape.fold(embed, self.layers.iter().enumerate(), |x, (i, layer)| layer.forward(cx, x, dropout, i as u64))
    }
}
