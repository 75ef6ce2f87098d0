//! Attention in turns within each view and across all views of a scene.

use crate::init::BackboneInit;
use crate::normalize::normalize_image;
use crate::vision_transformer::{VisionTransformer, VisionTransformerConfig};
use smallvec::SmallVec;
use std::sync::Arc;
use weaver_autograd::ops::RopeTable;
use weaver_autograd::{Outputs, ParamId, Real, Var, ops};
use weaver_nn::{Block, BlockConfig, Builder, Context};

/// Base of the rotary frequencies.
const ROPE_BASE: f64 = 100.0;
/// Epsilon of the blocks' layer normalizations.
const EPSILON: f64 = 1e-5;

/// Sizes of an [`Aggregator`].
#[derive(Clone, Debug, PartialEq)]
pub struct AggregatorConfig {
    /// The patch encoder, whose token width is the aggregator's.
    pub encoder: VisionTransformerConfig,
    /// Rounds of one frame block and one global block.
    pub rounds: usize,
    /// Attention heads; the width of one is divisible by 4.
    pub heads: usize,
    /// Hidden width of a block's perceptron over the token width.
    pub mlp_ratio: usize,
    /// Register tokens of a view.
    pub registers: usize,
    /// The rounds whose tokens the dense heads read, in order; repeats are allowed.
    pub layers: Vec<usize>,
}

/// The outputs of an [`Aggregator`] for a batch of scenes.
#[derive(Clone, Debug)]
pub struct Aggregated<'t, T: Real = f32> {
    /// Tokens of the requested rounds `[B, V, P, 2 D]`: the frame block's output beside the global block's. A view's P
    /// tokens are the camera token, the registers, and the patches row by row.
    pub layers: SmallVec<[Var<'t, T>; 4]>,
    /// The camera tokens of the last round `[B, V, 2 D]`.
    pub camera: Var<'t, T>,
    /// Tokens before the first patch.
    pub special: usize,
    /// Rows and columns of patches.
    pub grid: [usize; 2],
}

impl<T: Real> Outputs<T> for Aggregated<'_, T> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        self.layers.for_each_var(visit);
        self.camera.for_each_var(visit);
    }
}

/// State handed from round to round: the tokens `[B V, P, D]`, the layers so far, and at the end the camera tokens.
type State<'t, T> = (Var<'t, T>, SmallVec<[Option<Var<'t, T>>; 4]>, Option<Var<'t, T>>);

/// The alternating-attention transformer of VGGT (Wang et al. 2025, arXiv 2503.11651).
///
/// Each view's patch tokens are preceded by a camera token and registers, one set for a scene's first view and one for
/// all others. A round is a block within each view, then one over all tokens of a scene. Queries and keys
/// are normalized and then rotated by their patch's row and column; the special tokens are not rotated.
#[derive(Clone, Debug)]
pub struct Aggregator {
    config: AggregatorConfig,
    patch_embed: VisionTransformer,
    camera_token: ParamId,
    register_token: ParamId,
    frame_blocks: Vec<Block>,
    global_blocks: Vec<Block>,
}

impl Aggregator {
    /// Builds `camera_token`, `register_token`, `patch_embed`, `frame_blocks.{i}` and `global_blocks.{i}`.
    pub fn new<T: Real>(mut b: Builder<'_, T>, config: AggregatorConfig, init: BackboneInit) -> Self {
        assert!(
            config.layers.iter().all(|layer| *layer < config.rounds),
            "layers {:?} of an aggregator with {} rounds",
            config.layers,
            config.rounds
        );
        let dim = config.encoder.dim;
        let block = BlockConfig {
            width: dim,
            heads: config.heads,
            hidden: config.mlp_ratio * dim,
            eps: EPSILON,
            layer_scale: Some(init.layer_scale),
            qk_norm: true,
            init: init.weight,
        };
        let mut blocks = |kind: &str| -> Vec<Block> {
            (0..config.rounds).map(|i| Block::new(b.scope(format_args!("{kind}.{i}")), &block)).collect()
        };
        Self {
            frame_blocks: blocks("frame_blocks"),
            global_blocks: blocks("global_blocks"),
            camera_token: b.add("camera_token", [1, 2, 1, dim], init.token),
            register_token: b.add("register_token", [1, 2, config.registers, dim], init.token),
            patch_embed: VisionTransformer::new(b.scope("patch_embed"), config.encoder.clone(), init),
            config,
        }
    }

    /// The patch encoder.
    pub fn patch_embed(&self) -> &VisionTransformer {
        &self.patch_embed
    }

    /// Runs on images `[B, V, 3, H, W]` in `[0, 1]`, whose sides are multiples of the patch.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, images: Var<'t, T>) -> Aggregated<'t, T> {
        let shape = images.shape();
        let fits = shape.rank() == 5 && shape[1] > 0;
        cx.tape.ensure_shapes(fits, "aggregator", "images [B, V, 3, H, W] of at least one view", &[shape]);
        let [scenes, views, channels, height, width] = [0, 1, 2, 3, 4].map(|axis| shape[axis]);
        let patch = self.config.encoder.patch;
        let grid = [height / patch, width / patch];
        let special = 1 + self.config.registers;
        let dim = self.config.encoder.dim;

        let count = special + grid[0] * grid[1];
        let (of_view, of_scene) = (self.rope(cx, grid, 1), self.rope(cx, grid, views));
        let embed = || {
            let patches = self.patches(cx, images.reshape([scenes * views, channels, height, width]));
            let x = ops::concat(&[self.special_tokens(cx, scenes, views), patches], 1);
            (x, SmallVec::from_elem(None, self.config.layers.len()), None)
        };
        let beside = |a: Var<'t, T>, b: Var<'t, T>, tokens: usize| {
            ops::concat(&[a, b], 2).reshape([scenes, views, tokens, 2 * dim])
        };
        let blocks = self.frame_blocks.iter().zip(&self.global_blocks).enumerate();
        let run_round = |state: State<'t, T>, (round, (frame, global)): (usize, (&Block, &Block))| {
            let (x, mut layers, mut camera) = state;
            let within = cx.part(format_args!("frame_blocks.{round}"), || frame.forward(cx, x, Some(&of_view)));
            let across = cx.part(format_args!("global_blocks.{round}"), || {
                global.forward(cx, within.reshape([scenes, views * count, dim]), Some(&of_scene))
            });
            let x = across.reshape([scenes * views, count, dim]);
            if self.config.layers.contains(&round) {
                let both = beside(within, x, count);
                for (layer, _) in layers.iter_mut().zip(&self.config.layers).filter(|(_, wanted)| **wanted == round) {
                    *layer = Some(both);
                }
            }
            if round + 1 == self.config.rounds {
                let both = beside(within.slice(1, 0, 1), x.slice(1, 0, 1), 1);
                camera = Some(both.reshape([scenes, views, 2 * dim]));
            }
            (x, layers, camera)
        };
        let (_, layers, camera) = cx.tape.fold(embed, blocks, run_round);
        Aggregated {
            layers: layers.into_iter().map(|layer| layer.expect("layers are below the number of rounds")).collect(),
            camera: camera.expect("an aggregator has at least one round"),
            special,
            grid,
        }
    }

    /// The patch encoder's tokens `[N, rows columns, D]` of images `[N, 3, H, W]` in `[0, 1]`.
    pub fn patches<'t, T: Real>(&self, cx: Context<'t, '_, T>, images: Var<'t, T>) -> Var<'t, T> {
        cx.part("patch_embed", || self.patch_embed.forward(cx, normalize_image(images)))
    }

    /// Camera and register tokens of every view `[B V, 1 + R, D]`.
    fn special_tokens<'t, T: Real>(&self, cx: Context<'t, '_, T>, scenes: usize, views: usize) -> Var<'t, T> {
        let dim = self.config.encoder.dim;
        let special = 1 + self.config.registers;
        let both = ops::concat(&[cx.param(self.camera_token), cx.param(self.register_token)], 2);
        let first = both.slice(1, 0, 1).expand([scenes, 1, special, dim]);
        let others = both.slice(1, 1, 1).expand([scenes, views - 1, special, dim]);
        ops::concat(&[first, others], 1).reshape([scenes * views, special, dim])
    }

    /// Angles of the tokens of `views` views, made once per tape.
    fn rope<T: Real>(&self, cx: Context<'_, '_, T>, grid: [usize; 2], views: usize) -> Arc<RopeTable<T>> {
        let head = self.config.encoder.dim / self.config.heads;
        let positions = Positions { special: 1 + self.config.registers, grid, views };
        cx.tape.pool().table((positions, head), || RopeTable::new(&positions.list(), head, ROPE_BASE))
    }
}

/// Positions of the tokens of some views.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Positions {
    special: usize,
    grid: [usize; 2],
    views: usize,
}

impl Positions {
    /// In each view, patches at (row + 1, column + 1) after special tokens at (0, 0), which are not rotated.
    fn list(&self) -> Vec<[usize; 2]> {
        let [rows, columns] = self.grid;
        let patches = (0..rows * columns).map(|i| [i / columns + 1, i % columns + 1]);
        std::iter::repeat_n([0, 0], self.special).chain(patches).collect::<Vec<_>>().repeat(self.views)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn special_tokens_are_at_the_origin() {
        let positions = Positions { special: 2, grid: [1, 2], views: 2 };
        let view = [[0, 0], [0, 0], [1, 1], [1, 2]];
        assert_eq!(positions.list(), [view, view].concat());
    }
}
