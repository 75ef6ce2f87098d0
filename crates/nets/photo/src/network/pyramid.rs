//! Features of photos of any size: convolutions down to 1/16, attention there, and back up.

use crate::config::{LEVELS, PhotoConfig};
use crate::prior::CHANNELS;
use weaver_autograd::{Real, Var, ops};
use weaver_nn::{Builder, Context, Conv2d, Known, Positions, Projections, ViewBlock, WeightInit};

const INIT: WeightInit = WeightInit::FanIn;

/// x + conv(GELU(conv(GELU(x)))); parameters `0` and `1`.
#[derive(Clone, Copy, Debug)]
struct Residual {
    first: Conv2d,
    second: Conv2d,
}

impl Residual {
    fn new<T: Real>(mut b: Builder<'_, T>, channels: usize) -> Self {
        Self {
            first: Conv2d::new(b.scope(0), channels, channels, 3, INIT),
            second: Conv2d::new(b.scope(1), channels, channels, 3, INIT),
        }
    }

    fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Var<'t, T> {
        x + self.second.forward(cx, self.first.forward(cx, x.gelu()).gelu())
    }
}

/// Half the size of the level above; parameters `enter` and `0`, `1`, ...
#[derive(Clone, Debug)]
struct Down {
    enter: Conv2d,
    blocks: Vec<Residual>,
}

/// From the level below: `enter` (1 x 1), enlarged and added to what the way down left, then a block `0`.
#[derive(Clone, Copy, Debug)]
struct Up {
    enter: Conv2d,
    block: Residual,
}

/// Convolutions at five sizes, with attention within and across photos at the smallest. Nothing in it depends on the
/// size or the number of photos.
///
/// Parameters: `stem`, `down.1` to `down.4`, `attention.N.within` and `attention.N.across` ([`ViewBlock`]), `up.3` to
/// `up.0`.
#[derive(Clone, Debug)]
pub(super) struct Pyramid {
    stem: Conv2d,
    down: Vec<Down>,
    attention: Vec<[ViewBlock; 2]>,
    up: Vec<Up>,
}

impl Pyramid {
    pub fn new<T: Real>(b: &mut Builder<'_, T>, config: &PhotoConfig) -> Self {
        let c = config.channels;
        let down = |b: &mut Builder<'_, T>, level: usize| {
            let mut b = b.scope(format_args!("down.{level}"));
            Down {
                enter: Conv2d::new(b.scope("enter"), c[level - 1], c[level], 3, INIT).with_stride(2),
                blocks: (0..config.blocks).map(|i| Residual::new(b.scope(i), c[level])).collect(),
            }
        };
        let up = |b: &mut Builder<'_, T>, level: usize| {
            let mut b = b.scope(format_args!("up.{level}"));
            let enter = Conv2d::new(b.scope("enter"), c[level + 1], c[level], 1, INIT);
            Up { enter, block: Residual::new(b.scope(0), c[level]) }
        };
        let block = |b: &mut Builder<'_, T>, round: usize, name: &str| {
            let b = b.scope(format_args!("attention.{round}.{name}"));
            ViewBlock::new(b, c[LEVELS - 1], config.head, config.mlp_ratio)
        };
        Self {
            stem: Conv2d::new(b.scope("stem"), CHANNELS, c[0], 3, INIT),
            down: (1..LEVELS).map(|level| down(b, level)).collect(),
            attention: (0..config.rounds).map(|n| ["within", "across"].map(|name| block(b, n, name))).collect(),
            up: (0..LEVELS - 1).rev().map(|level| up(b, level)).collect(),
        }
    }

    /// Features `[V, C, H, W]` of the input `[V, CHANNELS, H, W]`, H and W multiples of 16. `cameras` are projections
    /// `[V, 4, 4]` and their inverses.
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        input: Var<'t, T>,
        cameras: [Var<'t, T>; 2],
    ) -> Var<'t, T> {
        let mut levels = vec![self.stem.forward(cx, input)];
        for (level, down) in (1..).zip(&self.down) {
            let above = levels[level - 1].gelu();
            let entered = down.enter.forward(cx, above);
            levels.push(down.blocks.iter().fold(entered, |x, block| block.forward(cx, x)));
        }
        let mut x = levels.pop().map_or(input, |x| self.attend(cx, x, cameras));
        for up in &self.up {
            let Some(skip) = levels.pop() else { break };
            let [height, width] = [2, 3].map(|axis| skip.shape()[axis]);
            x = up.block.forward(cx, skip + up.enter.forward(cx, x).bilinear(height, width, false));
        }
        x
    }

    /// Attention over the pixels `[V, C, h, w]` of the smallest level.
    fn attend<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>, cameras: [Var<'t, T>; 2]) -> Var<'t, T> {
        let [views, channels, rows, columns] = [0, 1, 2, 3].map(|axis| x.shape()[axis]);
        let n = rows * columns;
        let [matrices, inverses] = cameras.map(|p| p.reshape([1, views, 4, 4]));
        let projections = Projections { matrices, inverses };
        let at = |views: usize| Positions { registers: 0, grid: [rows, columns], views };
        let mut tokens = x.reshape([views, channels, n]).permute(&[0, 2, 1]);
        for [within, across] in &self.attention {
            tokens = within.forward(cx, tokens, Known::Positions(at(1)));
            let all = tokens.reshape([1, views * n, channels]);
            tokens = across.forward(cx, all, Known::Cameras(at(views), &projections)).reshape([views, n, channels]);
        }
        tokens.permute(&[0, 2, 1]).reshape(x.shape())
    }
}

/// A map `[V, C, H', W']` without its padding.
pub(super) fn cropped<'t, T: Real>(map: Var<'t, T>, [height, width]: [usize; 2]) -> Var<'t, T> {
    map.slice(2, 0, height).slice(3, 0, width)
}

/// Maps `[V, C, H, W]` as rows of pixels `[V H W, C]`.
pub(super) fn pixel_rows<T: Real>(maps: Var<'_, T>) -> Var<'_, T> {
    let s = maps.shape();
    maps.permute(&[0, 2, 3, 1]).reshape([s[0] * s[2] * s[3], s[1]])
}

/// Maps side by side along the channels.
pub(super) fn joined<'t, T: Real>(maps: &[Var<'t, T>]) -> Var<'t, T> {
    ops::concat(maps, 1)
}
