//! The patch encoder: a vision transformer as in DINOv2.

use crate::init::BackboneInit;
use weaver_autograd::{ParamId, Real, Var, ops};
use weaver_nn::{Block, BlockConfig, Builder, Context, Conv2d, LayerNorm, WeightInit};

/// Epsilon of this encoder's layer normalizations; the rest of the backbone has 1e-5.
const EPSILON: f64 = 1e-6;

/// Sizes of a [`VisionTransformer`].
#[derive(Clone, Debug, PartialEq)]
pub struct VisionTransformerConfig {
    /// Side of a square patch, pixels.
    pub patch: usize,
    /// Width of a token.
    pub dim: usize,
    /// Number of blocks.
    pub depth: usize,
    /// Attention heads.
    pub heads: usize,
    /// Hidden width of a block's perceptron over `dim`.
    pub mlp_ratio: usize,
    /// Register tokens.
    pub registers: usize,
    /// Rows and columns of the learned position table.
    pub table: [usize; 2],
}

/// Patches of images to tokens: one linear map of each p x p patch.
#[derive(Clone, Debug)]
pub struct PatchEmbed {
    proj: Conv2d,
    patch: usize,
}

impl PatchEmbed {
    /// Builds `proj`.
    pub fn new<T: Real>(mut b: Builder<'_, T>, patch: usize, dim: usize) -> Self {
        let proj = Conv2d::new(b.scope("proj"), 3, dim, patch, WeightInit::FanIn).with_stride(patch).with_padding(0);
        Self { proj, patch }
    }

    /// Tokens `[N, h w, D]`, row by row, of images `[N, 3, H, W]` whose sides are multiples of the patch.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, images: Var<'t, T>) -> Var<'t, T> {
        cx.part("patch_embed", || {
            let shape = images.shape();
            let p = self.patch;
            let fits = shape.rank() == 4 && shape[2].is_multiple_of(p) && shape[3].is_multiple_of(p);
            let expected = format_args!("images [N, 3, H, W] with sides that are multiples of {p}");
            cx.tape.ensure_shapes(fits, "patch_embed", expected, &[shape]);
            let maps = self.proj.forward(cx, images);
            let [n, dim, h, w] = [0, 1, 2, 3].map(|axis| maps.shape()[axis]);
            maps.reshape([n, dim, h * w]).permute(&[0, 2, 1])
        })
    }
}

/// Vision transformer with register tokens and LayerScale, as in DINOv2 (Oquab et al. 2023, arXiv 2304.07193; Darcet et
/// al. 2023, arXiv 2309.16588).
///
/// The class and register tokens take part in attention and are dropped at the end. The position table is used as it
/// is where the image has as many patches each way, and otherwise resized (bicubic, antialiased).
#[derive(Clone, Debug)]
pub struct VisionTransformer {
    config: VisionTransformerConfig,
    cls_token: ParamId,
    pos_embed: ParamId,
    register_tokens: ParamId,
    patch_embed: PatchEmbed,
    blocks: Vec<Block>,
    norm: LayerNorm,
}

impl VisionTransformer {
    /// Builds `cls_token`, `pos_embed`, `register_tokens`, `patch_embed.proj`, `blocks.{i}` and `norm`.
    pub fn new<T: Real>(mut b: Builder<'_, T>, config: VisionTransformerConfig, init: BackboneInit) -> Self {
        let dim = config.dim;
        let [rows, columns] = config.table;
        let block = BlockConfig {
            width: dim,
            heads: config.heads,
            hidden: config.mlp_ratio * dim,
            eps: EPSILON,
            layer_scale: Some(1.0),
            qk_norm: false,
            init: init.weight,
        };
        Self {
            cls_token: b.add("cls_token", [1, 1, dim], init.token),
            pos_embed: b.add("pos_embed", [1, 1 + rows * columns, dim], init.position),
            register_tokens: b.add("register_tokens", [1, config.registers, dim], init.token),
            patch_embed: PatchEmbed::new(b.scope("patch_embed"), config.patch, dim),
            blocks: (0..config.depth).map(|i| Block::new(b.scope(format_args!("blocks.{i}")), &block)).collect(),
            norm: LayerNorm::new(b.scope("norm"), dim, EPSILON),
            config,
        }
    }

    /// Patch tokens `[N, h w, D]`, row by row, of normalized images `[N, 3, H, W]`.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, images: Var<'t, T>) -> Var<'t, T> {
        let blocks = self.blocks.iter().enumerate();
        let run = |x, (i, block): (usize, &Block)| cx.part(format_args!("blocks.{i}"), || block.forward(cx, x, None));
        cx.tape.steps(|| cx.tape.fold(|| self.embed(cx, images), blocks, run)).then(|x| self.read_out(cx, x)).end()
    }

    /// The first block's input: class token, registers and patches `[N, 1 + R + h w, D]`, with positions on all but the
    /// registers.
    pub fn embed<'t, T: Real>(&self, cx: Context<'t, '_, T>, images: Var<'t, T>) -> Var<'t, T> {
        let shape = images.shape();
        let patches = self.patch_embed.forward(cx, images);
        let [n, count, dim] = [0, 1, 2].map(|axis| patches.shape()[axis]);
        let (cls_position, grid) = self.positions(cx, shape[2] / self.config.patch, shape[3] / self.config.patch);
        let cls = (cx.param(self.cls_token) + cls_position).expand([n, 1, dim]);
        let registers = cx.param(self.register_tokens).expand([n, self.config.registers, dim]);
        ops::concat(&[cls, registers, patches + grid.expand([n, count, dim])], 1)
    }

    /// Patch tokens from the last block's output: normalized, without class token and registers.
    pub fn read_out<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Var<'t, T> {
        let special = 1 + self.config.registers;
        self.norm.forward(cx, x.slice(1, special, x.shape()[1] - special))
    }

    /// The linear map of patches.
    pub fn patch_embed(&self) -> &PatchEmbed {
        &self.patch_embed
    }

    /// The blocks in order.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The class token's position `[1, 1, D]` and the positions of a grid of patches `[1, rows columns, D]`.
    pub fn positions<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        rows: usize,
        columns: usize,
    ) -> (Var<'t, T>, Var<'t, T>) {
        let [table_rows, table_columns] = self.config.table;
        let dim = self.config.dim;
        let table = cx.param(self.pos_embed);
        let grid = table.slice(1, 1, table_rows * table_columns);
        let grid = if [rows, columns] == self.config.table {
            grid
        } else {
            let maps = grid.reshape([1, table_rows, table_columns, dim]).permute(&[0, 3, 1, 2]);
            maps.bicubic_antialias(rows, columns).permute(&[0, 2, 3, 1]).reshape([1, rows * columns, dim])
        };
        (table.slice(1, 0, 1), grid)
    }
}
