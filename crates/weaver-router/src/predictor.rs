//! Refines every Gaussian's raw parameters by attention over its neighbours in space.

use crate::layer::{Layer, TwoLayers};
use crate::{Neighbors, neighbor_average, neighbor_offset, neighbor_relation};
use weaver_autograd::ops::{self, Activation};
use weaver_autograd::{Real, Var};
use weaver_nn::{Builder, Context};

/// A point-transformer layer: vector attention of width C over each Gaussian and its nearest neighbours.
///
/// With q, k, v linear in x and d_ij = P2 relu(P1 (mu_j - mu_i)): a_ij = A2 relu(A1 (q_i - k_j + d_ij)), and
/// z_i = sum_j softmax_j(a_ij) (v_j + d_ij), the softmax separately per channel.
///
/// Parameters (below the builder's path): `to_q`, `to_k`, `to_v`, `pos_mlp.0`, `pos_mlp.2`, `attn_mlp.0`, `attn_mlp.2`.
/// Source: Zhao et al., Point Transformer, ICCV 2021, eq. 2-4; official SplatWeaver code, `NeighborFusionLayer`.
#[derive(Clone, Copy, Debug)]
pub struct NeighborFusion {
    query: Layer,
    key: Layer,
    value: Layer,
    displacement: TwoLayers,
    attention: TwoLayers,
}

impl NeighborFusion {
    /// A layer of C = `width` channels.
    pub fn new<T: Real>(builder: &mut Builder<'_, T>, width: usize) -> Self {
        Self {
            query: Layer::new(builder, "to_q", width, width),
            key: Layer::new(builder, "to_k", width, width),
            value: Layer::new(builder, "to_v", width, width),
            displacement: TwoLayers::new(&mut builder.scope("pos_mlp"), 3, width, width),
            attention: TwoLayers::new(&mut builder.scope("attn_mlp"), width, width, width),
        }
    }

    /// z [N, C] from features x [N, C] and means [N, 3]. Differentiable in both and in all parameters.
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, T>,
        x: Var<'t, T>,
        means: Var<'t, T>,
        neighbors: &Neighbors,
    ) -> Var<'t, T> {
        let _scope = cx.scope("pt_block");
        let [query, key, value] = [self.query, self.key, self.value].map(|l| l.forward(cx, x, Activation::None));
        let displacement = self.displacement.forward(cx, neighbor_offset(means, neighbors));
        let score = self.attention.forward(cx, neighbor_relation(query, key, displacement, neighbors));
        neighbor_average(score, value, displacement, neighbors)
    }
}

/// The parameter predictor: theta = W_o z + raw, z from [`NeighborFusion`] on x = W_in [mean | raw | pixel feature].
///
/// Parameters (below the builder's path): `input`, `pt_block.*`, `head.0`.
#[derive(Clone, Copy, Debug)]
pub struct NeighborPredictor {
    input: Layer,
    fusion: NeighborFusion,
    head: Layer,
}

impl NeighborPredictor {
    /// A predictor for `parameters` raw numbers per Gaussian beside its mean, with pixel features of `projector` channels
    /// and attention of `width` channels. With `zero_head` the refinement starts at exactly nothing.
    pub fn new<T: Real>(
        builder: &mut Builder<'_, T>,
        parameters: usize,
        projector: usize,
        width: usize,
        zero_head: bool,
    ) -> Self {
        let input = Layer::new(builder, "input", 3 + parameters + projector, width);
        let fusion = NeighborFusion::new(&mut builder.scope("pt_block"), width);
        let head = Layer::new(&mut builder.scope("head"), 0, width, parameters);
        if zero_head {
            head.scale(builder, 0.0);
        }
        Self { input, fusion, head }
    }

    /// The attended features z [N, C]: `means` [N, 3], `raw` [N, S - 3], `feature` [N, c].
    pub fn attend<'t, T: Real>(
        &self,
        cx: Context<'t, T>,
        means: Var<'t, T>,
        raw: Var<'t, T>,
        feature: Var<'t, T>,
        neighbors: &Neighbors,
    ) -> Var<'t, T> {
        let x = self.input.forward(cx, ops::concat(&[means, raw, feature], 1), Activation::None);
        self.fusion.forward(cx, x, means, neighbors)
    }

    /// The refined parameters [N, S - 3]. Differentiable in all inputs (through the means, but not through the choice of
    /// neighbours) and all parameters; the bias of `attn_mlp.2` has gradient zero, since a softmax does not see it.
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, T>,
        means: Var<'t, T>,
        raw: Var<'t, T>,
        feature: Var<'t, T>,
        neighbors: &Neighbors,
    ) -> Var<'t, T> {
        let _scope = cx.scope("gs_predictor");
        let attended = self.attend(cx, means, raw, feature, neighbors);
        self.head.forward(cx, attended, Activation::None) + raw
    }
}
