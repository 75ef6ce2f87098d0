//! From the levels of the pyramid to one map.

use weaver_autograd::{Real, Var};
use weaver_nn::{Builder, Context, Conv2d, LayerNorm, WeightInit};
use weaver_vggt::{FusionBlock, add_position};

/// Levels of the pyramid.
pub const LEVELS: usize = 3;

/// Brings each level's tokens to `features` channels and adds the levels up from coarse to fine. Parameters below
/// `dpt_head`: `norm<i>`, `scratch.layer<i>_rn`, `scratch.refinenet<i>`, `scratch.output_conv1`.
#[derive(Clone, Debug)]
pub struct Aggregation {
    levels: [(LayerNorm, Conv2d, FusionBlock); LEVELS],
    last: Conv2d,
}

impl Aggregation {
    pub fn new<T: Real>(mut b: Builder<'_, T>, widths: [usize; LEVELS], features: usize) -> Self {
        let init = WeightInit::FanIn;
        let mut level = |i: usize| {
            let name = i + 1;
            (
                LayerNorm::new(b.scope(format_args!("norm{name}")), widths[i], 1e-5),
                Conv2d::without_bias(b.scope(format_args!("scratch.layer{name}_rn")), widths[i], features, 3, init),
                FusionBlock::new(b.scope(format_args!("scratch.refinenet{name}")), features, name == LEVELS),
            )
        };
        let levels = std::array::from_fn(&mut level);
        Self { levels, last: Conv2d::new(b.scope("scratch.output_conv1"), features, features, 3, init) }
    }

    /// Patch tokens of each level `[V, rows columns, D]`, with their rows and columns, to a map of the finest level's
    /// size `[V, features, rows, columns]`; `image` is H, W.
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        tokens: &[(Var<'t, T>, [usize; 2])],
        image: [usize; 2],
    ) -> Var<'t, T> {
        let [height, width] = image;
        let map = |level: usize| {
            let ((norm, conv, _), (tokens, [rows, columns])) = (&self.levels[level], tokens[level]);
            let [views, _, channels] = [0, 1, 2].map(|axis| tokens.shape()[axis]);
            let map = norm.forward(cx, tokens).permute(&[0, 2, 1]).reshape([views, channels, rows, columns]);
            conv.forward(cx, add_position(map, height, width))
        };
        let fused = (0..LEVELS).rev().fold(None, |coarser, level| {
            let size = tokens[level.saturating_sub(1)].1;
            Some(self.levels[level].2.forward(cx, map(level), coarser, size))
        });
        add_position(self.last.forward(cx, fused.expect("there are levels")), height, width)
    }
}
