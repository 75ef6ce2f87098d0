//! An expert on one class or cluster of anomalies.

use weaver_autograd::ops::Activation;
use weaver_autograd::{Real, Var};
use weaver_nn::{Attention, Builder, Context, LayerNorm, Linear, WeightInit};

/// A transformer block with a narrow ReLU network: x += proj(attention(norm1 x)), x += mlp.1(ReLU(mlp.0(norm2 x))).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block {
    attention: Option<(LayerNorm, Attention)>,
    norm2: LayerNorm,
    narrow: Linear,
    wide: Linear,
}

impl Block {
    /// Builds the block, without attention if `heads` is `None`.
    pub fn new<T: Real>(mut builder: Builder<'_, T>, width: usize, hidden: usize, heads: Option<usize>) -> Self {
        let init = WeightInit::FanIn;
        let attention = heads.map(|heads| {
            let norm = LayerNorm::new(builder.scope("norm1"), width, 1e-5);
            (norm, Attention::new(builder.scope_here(), width, heads, false, init))
        });
        Self {
            attention,
            norm2: LayerNorm::new(builder.scope("norm2"), width, 1e-5),
            narrow: Linear::new(builder.scope("mlp.0"), width, hidden, init),
            wide: Linear::new(builder.scope("mlp.1"), hidden, width, init),
        }
    }

    /// x `[B, T, width]` gives the same shape.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Var<'t, T> {
        let attend = || match &self.attention {
            Some((norm, attention)) => x + attention.forward(cx, norm.forward(cx, x), None),
            None => x,
        };
        let transform = |x: Var<'t, T>| {
            let hidden = self.narrow.forward_with(cx, self.norm2.forward(cx, x), Activation::Relu);
            x + self.wide.forward(cx, hidden)
        };
        cx.tape.steps(attend).then(transform).end()
    }
}

/// Fully connected layers with GELU between them that end in one probability; parameters `0`, `1`, ...
#[derive(Clone, Debug)]
pub(crate) struct Tower(Vec<Linear>);

impl Tower {
    pub fn new<T: Real>(mut builder: Builder<'_, T>, width: usize, hidden: &[usize]) -> Self {
        let sizes: Vec<usize> = [width].iter().chain(hidden).chain(&[1]).copied().collect();
        let layer = |(i, pair): (usize, &[usize])| Linear::new(builder.scope(i), pair[0], pair[1], WeightInit::FanIn);
        Self(sizes.windows(2).enumerate().map(layer).collect())
    }

    /// x `[B, T, width]` gives `[B, T]`, in (0, 1).
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Var<'t, T> {
        let last = self.0.len() - 1;
        let logits = cx.tape.fold(
            || x,
            self.0.iter().enumerate(),
            |x, (i, layer)| layer.forward_with(cx, x, if i < last { Activation::Gelu } else { Activation::None }),
        );
        logits.sigmoid().reshape([x.shape()[0], x.shape()[1]])
    }
}

/// Sizes of an expert.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExpertSizes {
    /// Numbers of the task-aware features.
    pub width: usize,
    /// Hidden numbers of the block.
    pub hidden: usize,
    /// Attention heads; `None` for no attention.
    pub heads: Option<usize>,
    /// Hidden numbers of the layers that end in the score.
    pub tower: Vec<usize>,
}

impl ExpertSizes {
    /// The published sizes at width 1024, others in proportion.
    pub fn published(width: usize) -> Self {
        let tower = [2, 4, 8, 16].map(|part| (width / part).max(8)).to_vec();
        Self { width, hidden: width / 2, heads: Some(2), tower }
    }

    /// The published sizes without attention, with which an expert learns to separate videos, not snippets.
    pub fn local(width: usize) -> Self {
        Self { heads: None, ..Self::published(width) }
    }
}

/// A network that scores snippets by their task-aware features (D'Amicantonio et al., arXiv 2508.06318, section 3.3).
#[derive(Clone, Debug)]
pub struct Expert {
    block: Block,
    tower: Tower,
}

impl Expert {
    /// Builds the network.
    pub fn new<T: Real>(mut builder: Builder<'_, T>, sizes: &ExpertSizes) -> Self {
        Self {
            block: Block::new(builder.scope_here(), sizes.width, sizes.hidden, sizes.heads),
            tower: Tower::new(builder.scope("score"), sizes.width, &sizes.tower),
        }
    }

    /// z `[B, T, width]` gives scores `[B, T]` in (0, 1). Differentiable in z and the parameters.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, z: Var<'t, T>) -> Var<'t, T> {
        self.tower.forward(cx, cx.tape.steps(|| self.block.forward(cx, z)).end())
    }
}
