//! The appearance expert: photos and their cameras to raw numbers for each pixel.

mod aggregation;
mod gaussians;
mod merge;
mod opacity;

pub use gaussians::{Parametrization, RawGaussians};
pub use opacity::{Opacities, OpacityDegree};

use aggregation::{Aggregation, LEVELS};
use merge::Merge;
use weaver_autograd::{List, ParamId, Real, Var, ops};
use weaver_nn::{Builder, Context, Init, Known, LayerNorm, Linear, Positions, Projections, ViewBlock, WeightInit};
use weaver_pose::{CameraVars, Rays};

/// Numbers of a pixel's ray and color: origin, direction, moment, color.
const RAY_MAP: usize = 12;

/// Sizes of a [`Pyramid`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PyramidConfig {
    /// Side of the square patches of the finest level, pixels; the sides of images are multiples of four patches.
    pub patch: usize,
    /// Numbers of a token of the finest level, a multiple of the head and of 4; each further level has twice as many.
    pub width: usize,
    /// Blocks of each level.
    pub blocks: [usize; LEVELS],
    /// Numbers of an attention head: a multiple of 8.
    pub head: usize,
    /// Hidden numbers of a block's perceptron over the token's.
    pub mlp_ratio: usize,
    /// Register tokens of a view, which stand for no patch.
    pub registers: usize,
    /// Neighboring views that attend to one another at the middle level; divides the number of views.
    pub group: usize,
    /// Channels in which levels are added up: a multiple of 4.
    pub features: usize,
    /// True if attention across views uses the cameras.
    pub cameras: bool,
    /// True if rays are in world coordinates; false, in the frame of their own camera, is for ablations.
    pub world_rays: bool,
    /// Dependence of opacity on the direction.
    pub opacity: OpacityDegree,
    /// Factor on the initial weights of the last layer.
    pub gain: f64,
}

impl PyramidConfig {
    /// Numbers of a token at each level.
    pub fn widths(&self) -> [usize; LEVELS] {
        std::array::from_fn(|level| self.width << level)
    }

    /// Divisor of the sides of images: the patch of the coarsest level, pixels.
    pub fn side(&self) -> usize {
        self.patch << (LEVELS - 1)
    }
}

/// Intermediate values of the network, for tests and for parity with the published one.
#[derive(Clone, Debug)]
pub struct Features<'t, T: Real = f32> {
    /// Tokens `[V, registers + patches, D]` after the last block of each level.
    pub levels: List<Var<'t, T>>,
    /// The levels added up `[V, features, H / patch, W / patch]`.
    pub map: Var<'t, T>,
}

/// 2Xplat's appearance expert (Jeong et al., arXiv 2603.21064; the network is MVP, arXiv 2512.07806).
///
/// Patches of rays and colors are tokens of three levels: within each view; within it and, in turns, in groups of
/// neighboring views; within it and, in turns, across all views. Between levels 2 x 2 patches become one. Where tokens
/// of several views meet, attention depends on their cameras ([`weaver_nn::projective_attention`]). The levels are
/// added up at the resolution of the patches; one linear layer makes all numbers of a patch's pixels. Parameters have
/// the names of the published checkpoint.
#[derive(Clone, Debug)]
pub struct Pyramid {
    config: PyramidConfig,
    tokenizer: Linear,
    tokenizer_norm: LayerNorm,
    registers: ParamId,
    stages: Vec<Vec<ViewBlock>>,
    merges: Vec<Merge>,
    aggregation: Aggregation,
    decoder_norm: LayerNorm,
    decoder: Linear,
}

impl Pyramid {
    /// Adds the parameters of a network.
    ///
    /// # Panics
    /// When widths are no multiples of heads, or heads none of 8.
    pub fn new<T: Real>(mut b: Builder<'_, T>, config: PyramidConfig) -> Self {
        let PyramidConfig { patch, width, head, features, .. } = config;
        assert!(head.is_multiple_of(8) && width.is_multiple_of(head), "heads of {head} in tokens of {width}");
        let widths = config.widths();
        let init = WeightInit::FanIn;
        let blocks = |b: &mut Builder<'_, T>, level: usize| -> Vec<ViewBlock> {
            let block = |i: usize| {
                let b = b.scope(format_args!("stage{}.{i}", level + 1));
                ViewBlock::new(b, widths[level], head, config.mlp_ratio)
            };
            (0..config.blocks[level]).map(block).collect()
        };
        let token = Init::Normal(0.02);
        let tokenizer = Linear::without_bias(b.scope("image_tokenizer.1"), RAY_MAP * patch * patch, width, init);
        let tokenizer_norm = LayerNorm::without_bias(b.scope("image_tokenizer.2"), width, 1e-5);
        let registers = b.add("register_token_init", [1, 1, config.registers, width], token);
        let stages = (0..LEVELS).map(|level| blocks(&mut b, level)).collect();
        let merges = (1..LEVELS).map(|level| Merge::new(&mut b, level, widths[level - 1])).collect();
        let aggregation = Aggregation::new(b.scope("dpt_head"), widths, features);
        let decoder_norm = LayerNorm::without_bias(b.scope("gaussian_decoder.0"), features, 1e-5);
        let numbers = patch * patch * RawGaussians::<T>::numbers(config.opacity);
        let decoder = Linear::without_bias(b.scope("gaussian_decoder.1"), features, numbers, init);
        b.value_mut(decoder.weight).iter_mut().for_each(|w| *w *= T::from_f64(config.gain));
        Self { config, tokenizer, tokenizer_norm, registers, stages, merges, aggregation, decoder_norm, decoder }
    }

    /// The sizes.
    pub fn config(&self) -> &PyramidConfig {
        &self.config
    }

    /// Runs on photos `[V, 3, H, W]` in [0, 1] with their `cameras` (viewmats `[V, 3, 4]`, intrinsics `[V, 4]`): raw
    /// numbers of one Gaussian for each pixel. Differentiable in the photos, the cameras and the parameters.
    ///
    /// # Panics
    /// When H or W is no multiple of four patches, or V none of the group.
    #[track_caller]
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        photos: Var<'t, T>,
        cameras: &CameraVars<'t, T>,
    ) -> (RawGaussians<'t, T>, Features<'t, T>) {
        let shape = photos.shape();
        let side = self.config.side();
        // A single photo has no neighbor.
        let group = if shape.rank() > 0 && shape[0] == 1 { 1 } else { self.config.group };
        let fits = shape.rank() == 4
            && shape.dims()[2..].iter().all(|n| n.is_multiple_of(side))
            && shape[0].is_multiple_of(group);
        let expected = format_args!("photos [{group} n, 3, {side} h, {side} w]");
        cx.tape.ensure_shapes(fits, "pyramid", expected, &[shape]);
        let [height, width] = [shape[2], shape[3]];
        let rays = Rays::new(cameras, [height, width]);
        let features = self.features(cx, photos, &rays, cameras);
        let raw = self.decode(cx, features.map);
        (RawGaussians { raw, rays, opacity: self.config.opacity }, features)
    }

    /// The levels and their sum.
    fn features<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        photos: Var<'t, T>,
        rays: &Rays<'t, T>,
        cameras: &CameraVars<'t, T>,
    ) -> Features<'t, T> {
        let PyramidConfig { patch, registers, .. } = self.config;
        let [views, height, width] = [0, 2, 3].map(|axis| photos.shape()[axis]);
        let size = [height, width];
        let projections = self.config.cameras.then(|| weaver_pose::projections(cameras, size));
        let mut grid = size.map(|n| n / patch);
        let mut x = self.tokens(cx, photos, rays, cameras);
        let (mut levels, mut patches) = (List::new(), List::<(Var<'t, T>, [usize; 2])>::new());
        for (level, stage) in self.stages.iter().enumerate() {
            let together = [1, self.config.group.min(views), views][level];
            for (i, block) in stage.iter().enumerate() {
                let across = level > 0 && i % 2 == 1;
                x = cx.part(format_args!("stage{}.{i}", level + 1), || match (level, across) {
                    (0, _) => block.forward(cx, x, Known::Nothing),
                    (_, false) => block.forward(cx, x, Known::Positions(Positions { registers, grid, views: 1 })),
                    (_, true) => {
                        let positions = Positions { registers, grid, views: together };
                        across_views(cx, block, x, positions, projections)
                    }
                });
            }
            levels.push(x);
            patches.push((x.slice(1, registers, grid[0] * grid[1]), grid));
            if let Some(merge) = self.merges.get(level) {
                x = merge.forward(cx, x, registers, grid);
                grid = grid.map(|n| n / 2);
            }
        }
        let map = cx.part("dpt_head", || self.aggregation.forward(cx, &patches, size));
        Features { levels, map }
    }

    /// Registers and patches of each view `[V, registers + patches, D]`.
    fn tokens<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        photos: Var<'t, T>,
        rays: &Rays<'t, T>,
        cameras: &CameraVars<'t, T>,
    ) -> Var<'t, T> {
        let PyramidConfig { patch, registers, width: token, .. } = self.config;
        let [views, height, width] = [0, 2, 3].map(|axis| photos.shape()[axis]);
        let [rows, columns] = [height / patch, width / patch];
        let map = if self.config.world_rays {
            rays.map(photos)
        } else {
            let mut identity = [T::ZERO; 12];
            [0, 5, 10].into_iter().for_each(|i| identity[i] = T::ONE);
            let viewmats = cx.tape.constant(&identity.repeat(views), [views, 3, 4]);
            Rays::new(&CameraVars { viewmats, ..*cameras }, [height, width]).map(photos)
        };
        let map = map.reshape([views * rows, patch, columns, patch * RAY_MAP]).permute(&[0, 2, 1, 3]);
        let map = map.reshape([views, rows * columns, patch * patch * RAY_MAP]);
        let patches = self.tokenizer_norm.forward(cx, self.tokenizer.forward(cx, map));
        let of_views = cx.param(self.registers).reshape([1, registers, token]).expand([views, registers, token]);
        ops::concat(&[of_views, patches], 1)
    }

    /// The numbers of each pixel `[V H W, numbers]`.
    fn decode<'t, T: Real>(&self, cx: Context<'t, '_, T>, map: Var<'t, T>) -> Var<'t, T> {
        let [views, features, rows, columns] = [0, 1, 2, 3].map(|axis| map.shape()[axis]);
        let patch = self.config.patch;
        let tokens = map.reshape([views, features, rows * columns]).permute(&[0, 2, 1]);
        let raw = self.decoder.forward(cx, self.decoder_norm.forward(cx, tokens));
        let numbers = raw.shape()[2] / (patch * patch);
        let pixels = raw.reshape([views * rows, columns, patch, patch * numbers]).permute(&[0, 2, 1, 3]);
        pixels.reshape([views * rows * patch * columns * patch, numbers])
    }
}

/// A block over groups of neighboring views.
fn across_views<'t, T: Real>(
    cx: Context<'t, '_, T>,
    block: &ViewBlock,
    x: Var<'t, T>,
    positions: Positions,
    projections: Option<[Var<'t, T>; 2]>,
) -> Var<'t, T> {
    let [views, tokens, width] = [0, 1, 2].map(|axis| x.shape()[axis]);
    let (groups, together) = (views / positions.views, positions.views);
    let joined = x.reshape([groups, together * tokens, width]);
    let y = match projections {
        Some(both) => {
            let [matrices, inverses] = both.map(|p| p.reshape([groups, together, 4, 4]));
            block.forward(cx, joined, Known::Cameras(positions, &Projections { matrices, inverses }))
        }
        None => {
            // P = 1: the four-vectors stay as they are, and the rest is turned as with cameras.
            let identity: Vec<T> = (0..16).map(|i| if i % 5 == 0 { T::ONE } else { T::ZERO }).collect();
            let one = cx.tape.constant(&identity.repeat(views), [groups, together, 4, 4]);
            block.forward(cx, joined, Known::Cameras(positions, &Projections { matrices: one, inverses: one }))
        }
    };
    y.reshape(x.shape())
}
