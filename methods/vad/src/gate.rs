//! The gate from the scores of all experts to one score.

use crate::expert::{Block, Tower};
use weaver_autograd::{ParamId, Real, Var, ops};
use weaver_nn::{Builder, Context, Init, Linear, WeightInit};

/// Sizes of the gate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GateSizes {
    /// Numbers of the task-aware features.
    pub width: usize,
    /// Experts.
    pub experts: usize,
    /// Hidden numbers of the block.
    pub hidden: usize,
    /// Attention heads of the block; `None` for a block without attention.
    pub heads: Option<usize>,
    /// Hidden numbers of the layers that end in the score.
    pub tower: Vec<usize>,
    /// True if both attentions have residual paths; they then begin at zero.
    pub residual: bool,
}

impl GateSizes {
    /// The published sizes at width 1024, others in proportion.
    pub fn published(width: usize, experts: usize) -> Self {
        let tower = [1, 2, 4, 8].map(|part| (width / part).max(8)).to_vec();
        Self { width, experts, hidden: width, heads: Some(4), tower, residual: false }
    }

    /// The published sizes, residual and without attention in the block: as published, only sharp attention
    /// distinguishes snippets, and a gate learns to separate videos.
    pub fn local(width: usize, experts: usize) -> Self {
        Self { heads: None, residual: true, ..Self::published(width, experts) }
    }
}

/// A matrix `[width, width]`, applied as x W^T.
#[derive(Clone, Copy, Debug)]
struct Projection(ParamId);

impl Projection {
    fn new<T: Real>(builder: &mut Builder<'_, T>, name: &str, width: usize, init: Init) -> Self {
        Self(builder.add(name, [width, width], init))
    }

    /// x `[B, T, width]` gives `[B, T, 1, width]`, the shape of attention with one head.
    fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Var<'t, T> {
        let shape = x.shape();
        x.matmul_with(cx.param(self.0), false, true).reshape([shape[0], shape[1], 1, shape[2]])
    }
}

/// Attention in both directions between features and expert scores, a block and a score (D'Amicantonio et al., arXiv
/// 2508.06318, section 3.4). There is no softmax over experts: the gate makes a score of its own.
#[derive(Clone, Debug)]
pub struct Gate {
    input: Linear,
    /// Projections q1, k1, v1, q2, k2, v2.
    projections: [Projection; 6],
    block: Block,
    tower: Tower,
    residual: bool,
}

impl Gate {
    /// Builds the gate.
    pub fn new<T: Real>(mut builder: Builder<'_, T>, sizes: &GateSizes) -> Self {
        let names = ["q1", "k1", "v1", "q2", "k2", "v2"];
        Self {
            input: Linear::new(builder.scope("in"), sizes.experts, sizes.width, WeightInit::FanIn),
            projections: names.map(|name| {
                let starts_at_zero = sizes.residual && name.starts_with('v');
                let init = if starts_at_zero { Init::Constant(0.0) } else { Init::fan_in(sizes.width) };
                Projection::new(&mut builder, name, sizes.width, init)
            }),
            block: Block::new(builder.scope_here(), 2 * sizes.width, sizes.hidden, sizes.heads),
            tower: Tower::new(builder.scope("score"), 2 * sizes.width, &sizes.tower),
            residual: sizes.residual,
        }
    }

    /// The layer on expert scores; column i of its weight belongs to expert i.
    pub fn input(&self) -> Linear {
        self.input
    }

    /// z `[B, T, width]` and expert scores `[B, T, experts]` give scores `[B, T]` in (0, 1): with `B = in(E)`,
    /// `[softmax(Q1 z (K1 z)^T / sqrt d) V1 B ; softmax(Q2 B (K2 B)^T / sqrt d) V2 z]`, plus `[B ; z]` if the gate is
    /// residual, goes through block and layers. Differentiable in both and the parameters.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, z: Var<'t, T>, experts: Var<'t, T>) -> Var<'t, T> {
        let b = self.input.forward(cx, experts);
        let [q1, k1, v1, q2, k2, v2] = self.projections;
        let scale = 1.0 / (z.shape().last() as f64).sqrt();
        let attend = |q: Var<'t, T>, k, v| ops::attention(q, k, v, scale).reshape(z.shape());
        let of_scores = attend(q1.forward(cx, z), k1.forward(cx, z), v1.forward(cx, b));
        let of_features = attend(q2.forward(cx, b), k2.forward(cx, b), v2.forward(cx, z));
        let (of_scores, of_features) =
            if self.residual { (b + of_scores, z + of_features) } else { (of_scores, of_features) };
        let both = ops::concat(&[of_scores, of_features], 2);
        self.tower.forward(cx, cx.tape.steps(|| self.block.forward(cx, both)).end())
    }
}
