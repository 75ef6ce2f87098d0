//! The transformer block.

use crate::{Attention, Builder, Context, Init, LayerNorm, Mlp, WeightInit};
use std::sync::Arc;
use weaver_autograd::ops::{self, RopeTable};
use weaver_autograd::{ParamId, Real, Var};

/// The sizes and options of a [`Block`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockConfig {
    /// Numbers per token.
    pub width: usize,
    /// Attention heads, which divide the width.
    pub heads: usize,
    /// Hidden numbers of the second half; usually four times the width.
    pub hidden: usize,
    /// Added to variances in both layer normalizations.
    pub eps: f64,
    /// Initial factor of both residual branches; without one the branches are added as they are.
    pub layer_scale: Option<f64>,
    /// True if queries and keys are normalized per head.
    pub qk_norm: bool,
    /// Initial weights.
    pub init: WeightInit,
}

/// A pre-norm transformer block: x += ls1 * attn(norm1(x)), then x += ls2 * mlp(norm2(x)).
///
/// Parameters `norm1`, `attn`, `ls1.gamma`, `norm2`, `mlp`, `ls2.gamma`. (Xiong et al., arXiv 2002.04745; LayerScale:
/// Touvron et al., arXiv 2103.17239.)
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// use weaver_nn::{Block, BlockConfig, Builder, Context, WeightInit};
/// let (mut params, init) = (Params::<f32>::new(), WeightInit::FanIn);
/// let config = BlockConfig { width: 8, heads: 2, hidden: 32, eps: 1e-6, layer_scale: Some(0.0), qk_norm: false, init };
/// let block = Block::new(Builder::new(&mut params, 0).scope("block"), &config);
/// let tape = Tape::new();
/// let x = tape.constant(&[0.5; 24], [1, 3, 8]);
/// // Branches of factor 0 leave x as it is.
/// assert_eq!(block.forward(Context::new(&tape, &params), x, None).to_vec(), x.to_vec());
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Block {
    norm1: LayerNorm,
    attn: Attention,
    ls1: Option<ParamId>,
    norm2: LayerNorm,
    mlp: Mlp,
    ls2: Option<ParamId>,
}

/// x + gamma * y, or x + y.
fn add<'t, T: Real>(cx: Context<'t, '_, T>, x: Var<'t, T>, gamma: Option<ParamId>, y: Var<'t, T>) -> Var<'t, T> {
    match gamma {
        Some(gamma) => ops::scale_residual(x, cx.param(gamma), y),
        None => x + y,
    }
}

impl Block {
    /// Builds the block.
    pub fn new<T: Real>(mut builder: Builder<'_, T>, config: &BlockConfig) -> Self {
        let &BlockConfig { width, heads, hidden, eps, layer_scale, qk_norm, init } = config;
        let gamma = |builder: &mut Builder<'_, T>, name| {
            layer_scale.map(|scale| builder.scope(name).add("gamma", [width], Init::Constant(scale)))
        };
        Self {
            norm1: LayerNorm::new(builder.scope("norm1"), width, eps),
            attn: Attention::new(builder.scope("attn"), width, heads, qk_norm, init),
            ls1: gamma(&mut builder, "ls1"),
            norm2: LayerNorm::new(builder.scope("norm2"), width, eps),
            mlp: Mlp::new(builder.scope("mlp"), width, hidden, width, init),
            ls2: gamma(&mut builder, "ls2"),
        }
    }

    /// Applies it to x `[B, N, D]`, which gives the same shape; `rope` rotates queries and keys by their tokens'
    /// positions. Differentiable in x and the parameters; the table is constant. With [`Context::recompute`] the block
    /// keeps x alone, and is computed again on the way back: the same bits for less memory and more time.
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        x: Var<'t, T>,
        rope: Option<&Arc<RopeTable<T>>>,
    ) -> Var<'t, T> {
        cx.layer(self.norm1.weight, "norm1.weight", || {
            if !(cx.recompute && cx.tape.is_recording()) {
                return self.branches(cx, x, rope.map(Arc::as_ref));
            }
            let (block, rope) = (*self, rope.cloned());
            ops::checkpoint(cx.params, &[x], move |tape, params, x| {
                block.branches(Context::new(tape, params), x[0], rope.as_deref())
            })
        })
    }

    fn branches<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>, rope: Option<&RopeTable<T>>) -> Var<'t, T> {
        let attend = || add(cx, x, self.ls1, self.attn.forward(cx, self.norm1.forward(cx, x), rope));
        let transform = |x| add(cx, x, self.ls2, self.mlp.forward(cx, self.norm2.forward(cx, x)));
        cx.tape.steps(attend).then(transform).end()
    }
}
