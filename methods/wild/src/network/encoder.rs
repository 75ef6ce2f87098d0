//! Patch tokens of a photo to one vector.

use weaver_autograd::ops::RopeTable;
use weaver_autograd::{ParamId, Real, Var, ops};
use weaver_nn::{Block, BlockConfig, Builder, Context, Init, Linear, WeightInit};

/// Base of the rotary frequencies.
const ROPE_BASE: f64 = 100.0;
/// Epsilon of the blocks' layer normalizations.
const EPSILON: f64 = 1e-5;

/// Sizes of an [`AppearanceEncoder`].
#[derive(Clone, Debug, PartialEq)]
pub struct AppearanceEncoderConfig {
    /// Width D of a token.
    pub width: usize,
    /// Attention heads; the width of one is divisible by 4.
    pub heads: usize,
    /// Transformer blocks: 2 as published.
    pub blocks: usize,
    /// Hidden width of a block's perceptron over `width`.
    pub mlp_ratio: usize,
    /// Initial factor of the blocks' branches: 1 as published.
    pub layer_scale: f64,
    /// Hidden widths of the perceptron on the token: 512, 512 as published.
    pub hidden: Vec<usize>,
    /// Numbers of an embedding: 32 as published.
    pub embedding: usize,
    /// Initial weights.
    pub init: WeightInit,
}

/// The embedding of a photo's look: a learned token before the photo's patch tokens, transformer blocks over all of
/// them, and a perceptron on the learned token's output.
///
/// Queries and keys are normalized and turned by their patch's row and column; the learned token is at the origin. The
/// embedding is unbounded. Parameters `app_token`, `blocks.{i}` and `head.{0, 2, ..}`.
#[derive(Clone, Debug)]
pub struct AppearanceEncoder {
    width: usize,
    heads: usize,
    token: ParamId,
    blocks: Vec<Block>,
    head: Vec<Linear>,
}

/// Positions of the tokens of a photo, as the key of their rotary table.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Grid {
    rows: usize,
    columns: usize,
}

impl AppearanceEncoder {
    /// Builds `app_token`, `blocks.{i}` and `head.{2 i}`.
    pub fn new<T: Real>(mut b: Builder<'_, T>, config: &AppearanceEncoderConfig) -> Self {
        let &AppearanceEncoderConfig { width, heads, blocks, mlp_ratio, layer_scale, embedding, init, .. } = config;
        let block = BlockConfig {
            width,
            heads,
            hidden: mlp_ratio * width,
            eps: EPSILON,
            layer_scale: Some(layer_scale),
            qk_norm: true,
            init,
        };
        let ends = config.hidden.iter().copied().chain([embedding]);
        let starts = std::iter::once(width).chain(config.hidden.iter().copied());
        let layers: Vec<[usize; 2]> = starts.zip(ends).map(|(from, to)| [from, to]).collect();
        Self {
            width,
            heads,
            token: b.add("app_token", [1, 1, width], Init::Normal(0.02)),
            blocks: (0..blocks).map(|i| Block::new(b.scope(format_args!("blocks.{i}")), &block)).collect(),
            head: (layers.iter().enumerate())
                .map(|(i, [from, to])| {
                    Linear::new(b.scope(format_args!("head.{}", 2 * i)), *from, *to, WeightInit::FanIn)
                })
                .collect(),
        }
    }

    /// Embeddings `[T, E]` of T photos' patch tokens `[T, rows columns, D]`, row by row. Differentiable in tokens and
    /// parameters.
    #[track_caller]
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        tokens: Var<'t, T>,
        [rows, columns]: [usize; 2],
    ) -> Var<'t, T> {
        let shape = tokens.shape();
        let fits = shape.rank() == 3 && shape[1] == rows * columns && shape[2] == self.width;
        let expected = format_args!("tokens [T, {rows} {columns}, {}]", self.width);
        cx.tape.ensure_shapes(fits, "appearance_encoder", expected, &[shape]);
        let photos = shape[0];
        let head = self.width / self.heads;
        let grid = Grid { rows, columns };
        let angles = cx.tape.pool().table((grid, head), || RopeTable::new(&grid.positions(), head, ROPE_BASE));
        let token = cx.param(self.token).expand([photos, 1, self.width]);
        let begin = || ops::concat(&[token, tokens], 1);
        let blocks = self.blocks.iter().enumerate();
        let x = cx.tape.fold(begin, blocks, |x, (i, block)| {
            cx.part(format_args!("blocks.{i}"), || block.forward(cx, x, Some(&angles)))
        });
        let x = x.slice(1, 0, 1).reshape([photos, self.width]);
        let (last, hidden) = self.head.split_last().expect("there is always a last layer");
        last.forward(cx, hidden.iter().fold(x, |x, layer| layer.forward(cx, x).gelu()))
    }
}

impl Grid {
    /// The learned token at the origin, patches at (row + 1, column + 1).
    fn positions(self) -> Vec<[usize; 2]> {
        let patches = (0..self.rows * self.columns).map(|i| [i / self.columns + 1, i % self.columns + 1]);
        std::iter::once([0, 0]).chain(patches).collect()
    }
}
