//! A transformer block for the tokens of views: without biases, its attention may depend on positions and cameras.

use crate::{
    Builder, Context, LayerNorm, Linear, Positions, Projections, RmsNorm, WeightInit, projective_attention,
    turned_attention,
};
use weaver_autograd::ops::{self, Activation};
use weaver_autograd::{Real, Var};

/// Added to variances and mean squares.
const EPSILON: f64 = 1e-5;
const INIT: WeightInit = WeightInit::FanIn;

/// Geometry of tokens as an input of attention.
#[derive(Clone, Copy, Debug)]
pub enum Known<'a, 't, T: Real> {
    /// Neither positions nor cameras.
    Nothing,
    /// Positions within the view.
    Positions(Positions),
    /// Positions within the view, and the cameras of the views.
    Cameras(Positions, &'a Projections<'t, T>),
}

/// A transformer block for the tokens of views: x += attn(ln1 x), then x += mlp(ln2 x), without biases.
///
/// Parameters `ln1`, `attn.{to_qkv, q_norm, k_norm, c_proj}`, `ln2`, `mlp.{c_fc, c_proj}`. Source: MVP, arXiv
/// 2512.07806.
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// use weaver_nn::{Builder, Context, Known, Positions, ViewBlock};
/// let mut params = Params::<f32>::new();
/// let block = ViewBlock::new(Builder::new(&mut params, 0), 16, 8, 2);
/// let tape = Tape::new();
/// let tokens = tape.constant(&[0.5; 2 * 6 * 16], [2, 6, 16]);
/// let positions = Positions { registers: 0, grid: [2, 3], views: 1 };
/// let y = block.forward(Context::new(&tape, &params), tokens, Known::Positions(positions));
/// assert_eq!(y.shape().dims(), [2, 6, 16]);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ViewBlock {
    ln1: LayerNorm,
    to_qkv: Linear,
    q_norm: RmsNorm,
    k_norm: RmsNorm,
    attended: Linear,
    ln2: LayerNorm,
    c_fc: Linear,
    c_proj: Linear,
    /// Numbers of a head.
    head: usize,
}

impl ViewBlock {
    /// A block for tokens of `width` numbers, a multiple of `head`, the numbers of an attention head: a multiple of 8.
    pub fn new<T: Real>(mut b: Builder<'_, T>, width: usize, head: usize, mlp_ratio: usize) -> Self {
        let hidden = mlp_ratio * width;
        Self {
            ln1: LayerNorm::without_bias(b.scope("ln1"), width, EPSILON),
            to_qkv: Linear::without_bias(b.scope("attn.to_qkv"), width, 3 * width, INIT),
            q_norm: RmsNorm::new(b.scope("attn.q_norm"), head, EPSILON),
            k_norm: RmsNorm::new(b.scope("attn.k_norm"), head, EPSILON),
            attended: Linear::without_bias(b.scope("attn.c_proj"), width, width, INIT),
            ln2: LayerNorm::without_bias(b.scope("ln2"), width, EPSILON),
            c_fc: Linear::without_bias(b.scope("mlp.c_fc"), width, hidden, INIT),
            c_proj: Linear::without_bias(b.scope("mlp.c_proj"), hidden, width, INIT),
            head,
        }
    }

    /// Applies the block to tokens `[B, n, D]`, which attend within their batch entry. Differentiable in x, the cameras
    /// and the parameters.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>, known: Known<'_, 't, T>) -> Var<'t, T> {
        cx.layer(self.ln1.weight, "ln1.weight", || {
            let x = x + self.attend(cx, self.ln1.forward(cx, x), known);
            let hidden = self.c_fc.forward_with(cx, self.ln2.forward(cx, x), Activation::Gelu);
            x + self.c_proj.forward(cx, hidden)
        })
    }

    fn attend<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>, known: Known<'_, 't, T>) -> Var<'t, T> {
        let [batch, tokens, width] = [0, 1, 2].map(|axis| x.shape()[axis]);
        let qkv = ops::split(self.to_qkv.forward(cx, x), 2, &[width; 3]);
        let [q, k, v] = [0, 1, 2].map(|i| qkv[i].reshape([batch, tokens, width / self.head, self.head]));
        let (q, k) = (self.q_norm.forward(cx, q), self.k_norm.forward(cx, k));
        let heads = match known {
            Known::Nothing => ops::attention(q, k, v, 1.0 / (self.head as f64).sqrt()),
            Known::Positions(positions) => turned_attention(q, k, v, &positions.turns(cx.tape, self.head)),
            Known::Cameras(positions, cameras) => {
                projective_attention(q, k, v, cameras, &positions.turns(cx.tape, self.head / 2))
            }
        };
        self.attended.forward(cx, heads.reshape([batch, tokens, width]))
    }
}
