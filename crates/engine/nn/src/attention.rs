//! Multi-head self-attention.

use crate::{Builder, Context, LayerNorm, Linear, WeightInit};
use weaver_autograd::ops::{self, RopeTable};
use weaver_autograd::{List, Real, Var};

/// Multi-head self-attention with one matrix for queries, keys and values; parameters `qkv` (rows q, then k, then v,
/// each heads x head width), `proj`, and with normalized queries and keys `q_norm`, `k_norm`.
///
/// Per head softmax(q k^T / sqrt(head width)) v, then `proj` of the heads side by side (Vaswani et al., arXiv
/// 1706.03762).
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// use weaver_nn::{Attention, Builder, Context, WeightInit};
/// let mut params = Params::<f32>::new();
/// let layer = Attention::new(Builder::new(&mut params, 0).scope("attn"), 8, 2, true, WeightInit::FanIn);
/// let tape = Tape::new();
/// let y = layer.forward(Context::new(&tape, &params), tape.constant(&[0.5; 24], [1, 3, 8]), None);
/// assert_eq!(y.shape().dims(), [1, 3, 8]);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Attention {
    /// From the width to three times the width.
    pub qkv: Linear,
    /// From the concatenated heads to the width.
    pub proj: Linear,
    /// Layer normalization of every head's queries and keys.
    pub norms: Option<(LayerNorm, LayerNorm)>,
    /// Number of heads.
    pub heads: usize,
}

impl Attention {
    /// A layer for tokens of `width` numbers with `heads` heads; `qk_norm` normalizes queries and keys per head (eps
    /// 1e-5). Panics if `heads` does not divide `width`.
    pub fn new<T: Real>(
        mut builder: Builder<'_, T>,
        width: usize,
        heads: usize,
        qk_norm: bool,
        init: WeightInit,
    ) -> Self {
        assert!(heads > 0 && width.is_multiple_of(heads), "a width of {width} cannot be divided among {heads} heads");
        let qkv = Linear::new(builder.scope("qkv"), width, 3 * width, init);
        let norms = qk_norm.then(|| {
            let q = LayerNorm::new(builder.scope("q_norm"), width / heads, 1e-5);
            (q, LayerNorm::new(builder.scope("k_norm"), width / heads, 1e-5))
        });
        Self { qkv, norms, proj: Linear::new(builder.scope("proj"), width, width, init), heads }
    }

    /// Applies it to x `[B, N, D]`, which gives the same shape. With a table, queries and keys are rotated by their
    /// tokens' positions. Differentiable in x and the parameters; the table is constant.
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        x: Var<'t, T>,
        rope: Option<&RopeTable<T>>,
    ) -> Var<'t, T> {
        cx.layer(self.qkv.weight, "qkv.weight", || {
            cx.tape
                .steps(|| self.queries_keys_values(cx, x, rope))
                .then(|(q, k, v)| ops::attention(q, k, v, 1.0 / (q.shape().last() as f64).sqrt()))
                .then(|heads| self.proj.forward(cx, heads.reshape(x.shape())))
                .end()
        })
    }

    /// Queries, keys and values `[B, N, heads, D / heads]`, normalized and rotated.
    fn queries_keys_values<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        x: Var<'t, T>,
        rope: Option<&RopeTable<T>>,
    ) -> (Var<'t, T>, Var<'t, T>, Var<'t, T>) {
        let (shape, width) = (x.shape(), cx.params.get(self.proj.weight).shape()[0]);
        let fits = shape.rank() == 3 && shape[2] == width;
        cx.tape.ensure_shapes(fits, "attention", format_args!("x [B, N, {width}]"), &[shape]);
        let (batch, tokens) = (shape[0], shape[1]);
        let split = || ops::split(self.qkv.forward(cx, x), 2, &[width; 3]);
        let rotated = |qkv: List<Var<'t, T>>| {
            let [q, k, v] = [0, 1, 2].map(|i| qkv[i].reshape([batch, tokens, self.heads, width / self.heads]));
            let (q, k) = match &self.norms {
                Some((q_norm, k_norm)) => (q_norm.forward(cx, q), k_norm.forward(cx, k)),
                None => (q, k),
            };
            match rope {
                Some(table) => (q.rope2d(table), k.rope2d(table), v),
                None => (q, k, v),
            }
        };
        cx.tape.steps(split).then(rotated).end()
    }
}
