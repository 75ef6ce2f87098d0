//! Refinement of every Gaussian's raw parameters by attention over its neighbors in space.

use crate::two_layers::TwoLayers;
use crate::{Neighbors, neighbor_average, neighbor_offset, neighbor_relation};
use weaver_autograd::{Real, Var, ops};
use weaver_nn::{Builder, Context, Linear, WeightInit};

/// A point-transformer layer: vector attention of width C over each Gaussian and its nearest neighbors.
///
/// With q, k, v linear in x and d_ij = P2 relu(P1 (mu_j - mu_i)): a_ij = A2 relu(A1 (q_i - k_j + d_ij)), and
/// z_i = sum_j softmax_j(a_ij) (v_j + d_ij), the softmax separately per channel.
///
/// Parameters (below the builder's path): `to_q`, `to_k`, `to_v`, `pos_mlp.0`, `pos_mlp.2`, `attn_mlp.0`, `attn_mlp.2`.
/// Source: Zhao et al., Point Transformer, ICCV 2021, eq. 2-4; official SplatWeaver code, `NeighborFusionLayer`.
#[derive(Clone, Copy, Debug)]
pub struct NeighborFusion {
    query: Linear,
    key: Linear,
    value: Linear,
    displacement: TwoLayers,
    attention: TwoLayers,
}

impl NeighborFusion {
    /// Gaussians that attend at a time when nothing is recorded: few enough that their pairs take little memory, and
    /// enough work for all threads.
    pub const PART: usize = 8192;

    /// A layer of C = `width` channels.
    pub fn new<T: Real>(mut builder: Builder<'_, T>, width: usize) -> Self {
        let mut linear = |name| Linear::new(builder.scope(name), width, width, WeightInit::FanIn);
        let [query, key, value] = ["to_q", "to_k", "to_v"].map(&mut linear);
        Self {
            query,
            key,
            value,
            displacement: TwoLayers::new(builder.scope("pos_mlp"), 3, width, width),
            attention: TwoLayers::new(builder.scope("attn_mlp"), width, width, width),
        }
    }

    /// z `[N, C]` from features x `[N, C]` and means `[N, 3]`. Differentiable in both and in all parameters.
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        x: Var<'t, T>,
        means: Var<'t, T>,
        neighbors: &Neighbors,
    ) -> Var<'t, T> {
        cx.part("pt_block", || {
            let projected = [self.query, self.key, self.value].map(|l| l.forward(cx, x));
            let n = neighbors.len();
            if cx.tape.is_recording() || n <= Self::PART {
                return self.attend(cx, projected, means, neighbors);
            }
            // Without a backward pass, pairs of neighbors are in memory for some of the Gaussians at a time. Rows are
            // independent, so the bits are the same.
            let width = x.shape().last();
            let mut attended = cx.tape.pool().buffer(n * width);
            cx.tape.for_each(attended.chunks_mut(Self::PART * width).enumerate(), |(part, out)| {
                let some = neighbors.part(part * Self::PART..((part + 1) * Self::PART).min(n));
                out.copy_from_slice(&self.attend(cx, projected, means, &some).value());
            });
            cx.tape.constant_of(attended, [n, width])
        })
    }

    /// z of the Gaussians that have a list of neighbors.
    fn attend<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        [query, key, value]: [Var<'t, T>; 3],
        means: Var<'t, T>,
        neighbors: &Neighbors,
    ) -> Var<'t, T> {
        let score = |displacement| neighbor_relation(query, key, displacement, neighbors);
        cx.tape
            .steps(|| self.displacement.forward(cx, neighbor_offset(means, neighbors)))
            .then(|displacement| (displacement, self.attention.forward(cx, score(displacement))))
            .then(|(displacement, score)| neighbor_average(score, value, displacement, neighbors))
            .end()
    }
}

/// Refines raw parameters by attention over neighbors: theta = W_o z + raw, where z is [`NeighborFusion`] applied to
/// x = W_in `[mean | raw | pixel feature]`.
///
/// Parameters (below the builder's path): `input`, `pt_block.*`, `head.0`.
#[derive(Clone, Copy, Debug)]
pub struct NeighborPredictor {
    input: Linear,
    fusion: NeighborFusion,
    head: Linear,
}

impl NeighborPredictor {
    /// Adds the parameters of a predictor of `parameters` raw numbers per Gaussian (its mean not counted), with pixel
    /// features of `projector` channels and attention of `width` channels. With `zero_head` the refinement starts at
    /// zero.
    pub fn new<T: Real>(
        mut builder: Builder<'_, T>,
        parameters: usize,
        projector: usize,
        width: usize,
        zero_head: bool,
    ) -> Self {
        let inputs = 3 + parameters + projector;
        let input = Linear::new(builder.scope("input"), inputs, width, WeightInit::FanIn);
        let fusion = NeighborFusion::new(builder.scope("pt_block"), width);
        let init = if zero_head { WeightInit::Zero } else { WeightInit::FanIn };
        let head = Linear::new(builder.scope("head").scope(0), width, parameters, init);
        Self { input, fusion, head }
    }

    /// The attended features z `[N, C]`: `means` `[N, 3]`, `raw` `[N, S - 3]`, `feature` `[N, c]`.
    pub fn attend<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        means: Var<'t, T>,
        raw: Var<'t, T>,
        feature: Var<'t, T>,
        neighbors: &Neighbors,
    ) -> Var<'t, T> {
        cx.tape
            .steps(|| self.input.forward(cx, ops::concat(&[means, raw, feature], 1)))
            .then(|x| self.fusion.forward(cx, x, means, neighbors))
            .end()
    }

    /// The refined parameters `[N, S - 3]`. Differentiable in all inputs (through the means, but not through the choice
    /// of neighbors) and all parameters; the bias of `attn_mlp.2` has gradient zero, because a softmax does not depend
    /// on it.
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        means: Var<'t, T>,
        raw: Var<'t, T>,
        feature: Var<'t, T>,
        neighbors: &Neighbors,
    ) -> Var<'t, T> {
        cx.part("gs_predictor", || {
            cx.tape
                .steps(|| self.attend(cx, means, raw, feature, neighbors))
                .then(|attended| self.head.forward(cx, attended) + raw)
                .end()
        })
    }
}
