//! Dense prediction from transformer tokens: four layers of tokens become one map of the image's size.

use crate::fusion::{FusionBlock, resized};
use crate::position::add_position;
use weaver_autograd::ops::{self, Activation};
use weaver_autograd::{List, Real, Shape, Var};
use weaver_nn::{Builder, Context, Conv2d, ConvTranspose2d, LayerNorm, WeightInit};

/// Sizes of a [`DptHead`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DptConfig {
    /// Width of the tokens.
    pub dim: usize,
    /// Channels of the four levels after projection, fine to coarse; each divisible by 4.
    pub out_channels: [usize; 4],
    /// Channels while fusing.
    pub features: usize,
    /// Channels of the result; divisible by 4. The published classes have half of `features`.
    pub width: usize,
}

/// The tokens that a dense head reads.
#[derive(Clone, Copy, Debug)]
pub struct DenseTokens<'a, 't, T: Real = f32> {
    /// Four layers of tokens, fine to coarse, each `[.., P, C]` with equal leading dimensions.
    pub layers: &'a [Var<'t, T>],
    /// Tokens before the first patch; they are not read.
    pub special: usize,
    /// Rows and columns of patches.
    pub grid: [usize; 2],
    /// Height and width of the image, pixels.
    pub image: [usize; 2],
}

/// Change of a level's size after projection.
#[derive(Clone, Debug)]
enum Resize {
    Up(ConvTranspose2d),
    Keep,
    Down(Conv2d),
}

/// The trunk of a dense prediction transformer (Ranftl et al. 2021, arXiv 2103.13413, in VGGT's form).
///
/// Four layers of patch tokens are normalized, projected, given positions, brought to 4, 2, 1 and 1/2 times the patch
/// grid, fused from coarse to fine up to 8 times the grid, and resized to the image, at any patch size.
#[derive(Clone, Debug)]
pub struct DptHead {
    config: DptConfig,
    norm: LayerNorm,
    projects: [Conv2d; 4],
    resize_layers: [Resize; 4],
    layer_rn: [Conv2d; 4],
    /// From the finest to the coarsest.
    refine: [FusionBlock; 4],
    output_conv1: Conv2d,
}

impl DptHead {
    /// Builds `norm`, `projects.{i}`, `resize_layers.{0,1,3}`, `scratch.layer{i}_rn`, `scratch.refinenet{i}` and
    /// `scratch.output_conv1`.
    pub fn new<T: Real>(b: &mut Builder<'_, T>, config: DptConfig) -> Self {
        let DptConfig { dim, out_channels: oc, features, width } = config;
        let level = |i: usize| i + 1;
        let init = WeightInit::FanIn;
        Self {
            config,
            norm: LayerNorm::new(b.scope("norm"), dim, 1e-5),
            projects: std::array::from_fn(|i| Conv2d::new(b.scope(format_args!("projects.{i}")), dim, oc[i], 1, init)),
            resize_layers: std::array::from_fn(|i| {
                let b = b.scope(format_args!("resize_layers.{i}"));
                match i {
                    0 => Resize::Up(ConvTranspose2d::new(b, oc[i], oc[i], 4, init)),
                    1 => Resize::Up(ConvTranspose2d::new(b, oc[i], oc[i], 2, init)),
                    2 => Resize::Keep,
                    _ => Resize::Down(Conv2d::new(b, oc[i], oc[i], 3, init).with_stride(2)),
                }
            }),
            layer_rn: std::array::from_fn(|i| {
                let b = b.scope(format_args!("scratch.layer{}_rn", level(i)));
                Conv2d::without_bias(b, oc[i], features, 3, init)
            }),
            refine: std::array::from_fn(|i| {
                FusionBlock::new(b.scope(format_args!("scratch.refinenet{}", level(i))), features, i == 3)
            }),
            output_conv1: Conv2d::new(b.scope("scratch.output_conv1"), features, width, 3, init),
        }
    }

    /// Maps `[N, width, H, W]`, one for each of the N views that the leading dimensions hold.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, tokens: DenseTokens<'_, 't, T>) -> Var<'t, T> {
        cx.tape.steps(|| self.trunk(cx, tokens)).then(|maps| resized(maps, tokens.image)).end()
    }

    /// Maps `[N, width, 8 h, 8 w]` of a grid of h x w patches: [`forward`](Self::forward) before the last resize.
    pub fn trunk<'t, T: Real>(&self, cx: Context<'t, '_, T>, tokens: DenseTokens<'_, 't, T>) -> Var<'t, T> {
        cx.tape.steps(|| self.fuse(cx, tokens)[0]).then(|finest| self.output_conv1.forward(cx, finest)).end()
    }

    /// The fused maps `[N, features, ..]` from the finest to the coarsest, each at the size of the next finer level.
    pub fn fuse<'t, T: Real>(&self, cx: Context<'t, '_, T>, tokens: DenseTokens<'_, 't, T>) -> [Var<'t, T>; 4] {
        let found: List<Shape> = tokens.layers.iter().map(|layer| layer.shape()).collect();
        cx.tape.ensure_shapes(found.len() == 4, "dense_head", "four layers of tokens [B, V, tokens, 2 D]", &found);
        let levels = || std::array::from_fn(|i| self.level(cx, tokens, i));
        let size = |map: &Var<'t, T>| [map.shape()[2], map.shape()[3]];
        cx.tape.fold(levels, (0..4).rev(), |mut maps: [Var<'t, T>; 4], i| {
            let next = if i > 0 { size(&maps[i - 1]) } else { size(&maps[0]).map(|n| 2 * n) };
            maps[i] = cx.part(format_args!("scratch.refinenet{}", i + 1), || {
                self.refine[i].forward(cx, maps[i], maps.get(i + 1).copied(), next)
            });
            maps
        })
    }

    /// One layer's tokens as maps `[N, features, h, w]` of that level's size.
    fn level<'t, T: Real>(&self, cx: Context<'t, '_, T>, tokens: DenseTokens<'_, 't, T>, i: usize) -> Var<'t, T> {
        cx.part(format_args!("projects.{i}"), || {
            let steps = cx.tape.steps(|| self.resized_level(cx, tokens, i));
            steps.then(|resized| self.layer_rn[i].forward(cx, resized)).end()
        })
    }

    /// One layer's tokens, projected, with positions, as maps `[N, out_channels[i], h, w]` of that level's size.
    fn resized_level<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        tokens: DenseTokens<'_, 't, T>,
        i: usize,
    ) -> Var<'t, T> {
        let all = tokens.layers[i];
        let [rows, columns] = tokens.grid;
        let (count, dim) = (all.shape()[all.shape().rank() - 2], self.config.dim);
        let views = all.shape().rows() / count;
        let patches = all.reshape([views, count, dim]).slice(1, tokens.special, rows * columns);
        let x = self.norm.forward(cx, patches);
        // A 1x1 convolution is a linear map of each token: run as one, it reads them without a transpose.
        let channels = self.config.out_channels[i];
        let weight = cx.param(self.projects[i].weight).reshape([channels, dim]);
        let x = ops::linear(x, weight, self.projects[i].bias.map(|bias| cx.param(bias)), Activation::None);
        let x = x.permute(&[0, 2, 1]).reshape([views, channels, rows, columns]);
        let x = add_position(x, tokens.image[0], tokens.image[1]);
        match &self.resize_layers[i] {
            Resize::Up(conv) => conv.forward(cx, x),
            Resize::Keep => x,
            Resize::Down(conv) => conv.forward(cx, x),
        }
    }
}
