//! WildSplatter: one geometry from photos in different light, and colors under the light of any photo.

mod decoder;
mod encoder;
mod standardized;

pub use decoder::{LookDecoder, LookDecoderConfig};
pub use encoder::{AppearanceEncoder, AppearanceEncoderConfig};
pub use standardized::{LEAST_DEVIATION, standardized};

use crate::{WildConfig, WildParametrization};
use weaver_autograd::{Params, Real, Var, ops};
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::sh;
use weaver_nn::{Builder, Context, Conv2d, WeightInit};
use weaver_pose::CameraVars;
use weaver_splat::GaussianVars;
use weaver_vggt::{Encoded, FeatureHead, Vggt};

/// Numbers of a pixel's Gaussian: scales 3, quaternion 4 (xyzw), opacity, and offset along the ray, unless that has its
/// own decoder.
const NUMBERS: usize = 9;
const QUATERNION: usize = 3;
const OPACITY: usize = 7;
const OFFSET: usize = 8;
/// Smallest and largest published scale, in tenths of the sum of a pixel's width and height at its depth.
const SCALES: [f64; 2] = [1e-5, 30.0];

/// WildSplatter (Fujimura et al., arXiv 2604.21182): Gaussians of context photos, and their colors under the look of
/// any photo.
///
/// A scene takes four calls: [`encode`](Self::encode) and [`surface`](Self::surface) of the context,
/// [`embed`](Self::embed) of the photos with the wanted looks, [`colors`](Self::colors). The surface is independent of
/// looks: it is the same under all of them, to the bit, and gradients of geometry by embeddings do not exist.
/// Parameters `aggregator`, `camera_head`, `depth_head` and `gaussian_param_head` as in
/// [`SplatWeaver`](weaver_model::SplatWeaver), `gaussian_param_head.geometry`, `appearance` and `looks`.
#[derive(Clone, Debug)]
pub struct Wild {
    config: WildConfig,
    vggt: Vggt,
    features: FeatureHead,
    geometry: Conv2d,
    offset: Option<[Conv2d; 2]>,
    encoder: AppearanceEncoder,
    decoder: LookDecoder,
}

/// One Gaussian for each pixel of V photos, without colors.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'t, T: Real = f32> {
    /// Centers `[V H W, 3]` in the frame of the cameras.
    pub means: Var<'t, T>,
    /// Quaternions `[V H W, 4]`, wxyz, of any length.
    pub quats: Var<'t, T>,
    /// Scales `[V H W, 3]`.
    pub scales: Var<'t, T>,
    /// Opacities `[V H W]`.
    pub opacities: Var<'t, T>,
    /// Depth `[V, H, W]` of the pixels along the optical axis.
    pub depth: Var<'t, T>,
    /// Feature maps `[V, C, H, W]`.
    features: Var<'t, T>,
    /// The photos [standardized] `[V, 3, H, W]`.
    plain: Var<'t, T>,
    /// Matrices that rotate coefficients of colors from the axes of each camera to the world's, `[V, K, K]`.
    turns: Var<'t, T>,
}

impl<'t, T: Real> Surface<'t, T> {
    /// The surface's Gaussians with these colors `[V H W, K, 3]`.
    pub fn with_colors(&self, colors: Var<'t, T>) -> GaussianVars<'t, T> {
        let Self { means, quats, scales, opacities, .. } = *self;
        GaussianVars { means, quats, scales, opacities, colors }
    }

    /// The surface under a similarity: s means + b, s scales.
    #[must_use]
    pub fn placed(&self, scale: f64, shift: DVec3) -> Self {
        let n = self.means.shape()[0];
        let shift = self.means.tape().constant(&shift.to_array().map(T::from_f64), [1, 3]);
        Self { means: self.means * scale + shift.expand([n, 3]), scales: self.scales * scale, ..*self }
    }
}

impl Wild {
    /// Adds the parameters of a new model with initial values drawn from `seed`.
    ///
    /// # Panics
    /// If the configuration does not pass [`WildConfig::check`].
    pub fn new<T: Real>(config: WildConfig, params: &mut Params<T>, seed: u64) -> Self {
        Self::build(config, Builder::new(params, seed))
    }

    /// Declares the parameters of a model whose values will be loaded.
    ///
    /// # Panics
    /// If the configuration does not pass [`WildConfig::check`].
    pub fn declare<T: Real>(config: WildConfig, params: &mut Params<T>) -> Self {
        Self::build(config, Builder::declaring(params))
    }

    fn build<T: Real>(config: WildConfig, mut root: Builder<'_, T>) -> Self {
        config.check().unwrap_or_else(|message| panic!("{message}"));
        let vggt = Vggt::new(root.scope_here(), config.vggt());
        let features = FeatureHead::new(root.scope("gaussian_param_head"), config.feature_head());
        let mut head = root.scope("gaussian_param_head");
        let published = config.gaussians.parametrization == WildParametrization::Published;
        let (channels, numbers) = (config.dense.channels, if published { OFFSET } else { NUMBERS });
        let geometry = Conv2d::new(head.scope("geometry"), channels, numbers, 1, WeightInit::FanIn);
        let offset = published.then(|| {
            [("offset.0", channels, 3), ("offset.2", 1, 1)].map(|(name, outputs, kernel)| {
                Conv2d::new(head.scope(name), channels, outputs, kernel, WeightInit::FanIn)
            })
        });
        let gain = T::from_f64(config.gaussians.gain);
        head.value_mut(geometry.weight).iter_mut().for_each(|weight| *weight *= gain);
        let encoder = AppearanceEncoder::new(root.scope("appearance"), &config.encoder());
        let decoder = LookDecoder::new(root.scope("looks"), config.decoder());
        Self { config, vggt, features, geometry, offset, encoder, decoder }
    }

    /// The configuration of the model.
    pub fn config(&self) -> &WildConfig {
        &self.config
    }

    /// Runs backbone and camera head on photos `[B, V, 3, H, W]` in [0, 1]; returns tokens and cameras.
    pub fn encode<'t, T: Real>(&self, cx: Context<'t, '_, T>, photos: Var<'t, T>) -> Encoded<'t, T> {
        self.vggt.encode(cx, photos)
    }

    /// Depth `[V, H, W]` of the first `views` views of scene `b`.
    pub fn depth<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        encoded: &Encoded<'t, T>,
        b: usize,
        views: usize,
        size: [usize; 2],
    ) -> Var<'t, T> {
        self.vggt.depth(cx, encoded, b, [0, views], size).depth
    }

    /// The Gaussians of scene `b` from its photos `[V, 3, H, W]`, valid `inside` `[V, H, W]`, at `depth` `[V, H, W]`
    /// from `cameras` (viewmats `[V, 3, 4]`, intrinsics `[V, 4]`).
    ///
    /// Colors are turned with the cameras' values; everything else is differentiable in depth, tokens and cameras.
    pub fn surface<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        (encoded, b): (&Encoded<'t, T>, usize),
        photos: Var<'t, T>,
        inside: Option<&[bool]>,
        depth: Var<'t, T>,
        cameras: &CameraVars<'t, T>,
    ) -> Surface<'t, T> {
        let [views, height, width] = [0, 2, 3].map(|axis| photos.shape()[axis]);
        let pixels = height * width;
        let plain = standardized(&photos.value(), inside, pixels);
        let plain = cx.tape.constant(&plain, photos.shape());
        let (features, raw, farther) = cx.part("gaussian_param_head", || {
            let layers = encoded.view_tokens(b, 0, views);
            let tokens = encoded.dense_tokens(&layers, [height, width]);
            let features = self.features.forward(cx, tokens, plain).features;
            let farther =
                self.offset.as_ref().map(|[first, last]| last.forward(cx, first.forward(cx, features).relu()));
            (features, self.geometry.forward(cx, features), farther)
        });
        let n = views * pixels;
        let raw = raw.permute(&[0, 2, 3, 1]).reshape([n, raw.shape()[1]]);
        let gaussians = &self.config.gaussians;
        let part = |first: usize, count: usize| raw.slice(1, first, count);
        let of_each = |axis: usize| cameras.intrinsics.slice(1, axis, 1).expand([views, pixels]).reshape([n]);
        let depth = depth.reshape([n]);
        let depth = match farther {
            Some(farther) => depth + farther.reshape([n]).sigmoid(),
            None => depth * (part(OFFSET, 1).reshape([n]).tanh() * gaussians.offset_reach / of_each(0) + 1.0),
        };
        let (width_there, raw_scales) = (depth / of_each(0), part(0, 3));
        let scales = match gaussians.parametrization {
            WildParametrization::Published => {
                let size = (width_there + depth / of_each(1)) * 0.1;
                size.reshape([n, 1]).expand([n, 3]) * (raw_scales.sigmoid() * (SCALES[1] - SCALES[0]) + SCALES[0])
            }
            WildParametrization::Footprint => {
                width_there.reshape([n, 1]).expand([n, 3]) * raw_scales.clamp(-3.0, 3.0).exp() * gaussians.scale
            }
        };
        let depth = depth.reshape([views, height, width]);
        let means = weaver_pose::unproject(depth, cameras.viewmats, cameras.intrinsics, 0.5).reshape([n, 3]);
        let to_world = cameras.viewmats.slice(2, 0, 3).permute(&[0, 2, 1]);
        let turn = weaver_pose::xyzw_from_rotation(to_world).reshape([views, 1, 4]).expand([views, pixels, 4]);
        let one = cx.tape.constant_with([n, 4], |q| q.iter_mut().skip(3).step_by(4).for_each(|w| *w = T::ONE));
        let turned = weaver_pose::quaternion_product(turn.reshape([n, 4]), part(QUATERNION, 4) + one);
        let quats = ops::concat(&[turned.slice(1, 3, 1), turned.slice(1, 0, 3)], 1);
        let opacities = part(OPACITY, 1).reshape([n]).sigmoid();
        let turns = self.turns(cx, &cameras.viewmats.to_vec());
        Surface { means, quats, scales, opacities, depth, features, plain, turns }
    }

    /// Embeddings `[T, E]` of the looks of photos `[T, 3, H, W]` in [0, 1].
    pub fn embed<'t, T: Real>(&self, cx: Context<'t, '_, T>, photos: Var<'t, T>) -> Var<'t, T> {
        let patch = self.config.patch;
        let grid = [photos.shape()[2] / patch, photos.shape()[3] / patch];
        let tokens = self.vggt.patches(cx, photos);
        cx.part("appearance", || self.encoder.forward(cx, tokens, grid))
    }

    /// Colors `[T, V H W, K, 3]` of a surface under looks `[T, E]`, in the frame of its cameras.
    pub fn colors<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        surface: &Surface<'t, T>,
        looks: Var<'t, T>,
    ) -> Var<'t, T> {
        let colors = cx.part("looks", || self.decoder.forward(cx, surface.features, looks, surface.plain));
        let [count, n, k] = [0, 1, 2].map(|axis| colors.shape()[axis]);
        if k == 1 {
            return colors;
        }
        let views = surface.turns.shape()[0];
        let pixels = n / views;
        let turns = surface.turns.expand([count, views, k, k]).reshape([count * views, k, k]);
        let rows = colors.reshape([count * views, pixels, k, 3]).permute(&[0, 2, 1, 3]);
        let turned = turns.matmul(rows.reshape([count * views, k, pixels * 3]));
        turned.reshape([count * views, k, pixels, 3]).permute(&[0, 2, 1, 3]).reshape([count, n, k, 3])
    }

    /// The look for an unknown embedding: zeros `[1, E]`.
    pub fn no_look<'t, T: Real>(&self, cx: Context<'t, '_, T>) -> Var<'t, T> {
        cx.tape.constant_with([1, self.config.looks.embedding], |_| ())
    }

    /// Matrices that rotate coefficients of colors from the axes of cameras `[V, 3, 4]` to the world's.
    fn turns<'t, T: Real>(&self, cx: Context<'t, '_, T>, viewmats: &[T]) -> Var<'t, T> {
        let degree = self.config.gaussians.sh_degree;
        let k = (degree + 1).pow(2);
        cx.tape.constant_with([viewmats.len() / 12, k, k], |all| {
            all.fill(T::ZERO);
            for (matrix, view) in all.chunks_exact_mut(k * k).zip(viewmats.chunks_exact(12)) {
                // Columns of the matrix are rows of the view's rotation: camera to world.
                let columns = [0, 1, 2].map(|row| [0, 1, 2].map(|i| view[4 * row + i].to_f64()));
                matrix[0] = T::ONE;
                for (l, turn) in (1..).zip(sh::rotation(degree, &DMat3::from_cols_array_2d(&columns))) {
                    let (first, n) = (l * l, 2 * l + 1);
                    for (i, x) in turn.into_iter().enumerate() {
                        matrix[(first + i / n) * k + first + i % n] = T::from_f64(x);
                    }
                }
            }
        })
    }
}
