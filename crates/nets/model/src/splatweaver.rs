//! The whole network: photos to cameras and Gaussians.

use crate::stereo::Stereo;
use crate::{Guidance, ModelConfig, ParametrizationConfig};
use weaver_autograd::{Buffer, Params, Real, Var};
use weaver_experts::{CardinalityHead, PixelGaussians, PixelInputs};
use weaver_kernels::random::Stream;
use weaver_nn::{Builder, Context};
use weaver_pose::CameraVars;
use weaver_router::{Allocation, AllocationRequest, Assignment};
use weaver_splat::GaussianVars;
use weaver_vggt::{Encoded, FeatureHead, PixelFeatures, Vggt};
use weaver_wavelet::EnergyMap;

/// SplatWeaver: predicts cameras and a compact set of Gaussians from a few photos without poses.
///
/// A scene takes three calls: [`encode`](Self::encode), [`dense`](Self::dense) and [`gaussians`](Self::gaussians).
/// Source: Wan et al., SplatWeaver, arXiv 2605.07287. Parameter names follow the official checkpoint, without the
/// leading `encoder.`.
#[derive(Clone, Debug)]
pub struct SplatWeaver {
    config: ModelConfig,
    vggt: Vggt,
    features: FeatureHead,
    guidance: Option<Guidance>,
    head: CardinalityHead,
    stereo: Option<Stereo>,
}

/// The dense heads' output for one scene: all that is predicted before pixels are given Gaussians.
#[derive(Clone, Copy, Debug)]
pub struct Dense<'t, T: Real = f32> {
    /// Depth `[V, H, W]`.
    pub depth: Var<'t, T>,
    /// Confidence of the depth `[V, H, W]`, at least 1.
    pub confidence: Var<'t, T>,
    /// Expert features F as rows `[P, C]`.
    features: Var<'t, T>,
    /// The router's logits `[P, E]`.
    pub logits: Var<'t, T>,
    /// Wavelet energy `[P]`; a constant.
    pub energy: Var<'t, T>,
}

/// The Gaussians of a scene, and how many each pixel was given.
#[derive(Debug)]
pub struct PredictedGaussians<'t, T: Real = f32> {
    /// The N Gaussians, in the frame of the cameras that they were made with.
    pub gaussians: GaussianVars<'t, T>,
    /// The depth `[V, H, W]` on which they lie: the predicted one, or the one after comparing the views.
    pub depth: Var<'t, T>,
    /// The pixel that each Gaussian comes from `[N]`.
    pub pixel: Buffer<u32>,
    /// The number of Gaussians of each pixel.
    pub assignment: Assignment<T>,
    /// The straight-through choice `[P, E]`, if the router made it.
    pub choice: Option<Var<'t, T>>,
}

/// Maps `[V, C, H, W]` as rows of pixels `[V H W, C]`.
fn pixel_rows<T: Real>(maps: Var<'_, T>) -> Var<'_, T> {
    let s = maps.shape();
    maps.permute(&[0, 2, 3, 1]).reshape([s[0] * s[2] * s[3], s[1]])
}

impl SplatWeaver {
    /// Adds the parameters of a new model with initial values drawn from `seed`.
    ///
    /// # Panics
    /// If the configuration does not pass [`ModelConfig::check`].
    pub fn new<T: Real>(config: ModelConfig, params: &mut Params<T>, seed: u64) -> Self {
        Self::build(config, Builder::new(params, seed))
    }

    /// Declares the parameters of a model whose values will be loaded.
    ///
    /// # Panics
    /// If the configuration does not pass [`ModelConfig::check`].
    pub fn declare<T: Real>(config: ModelConfig, params: &mut Params<T>) -> Self {
        Self::build(config, Builder::declaring(params))
    }

    fn build<T: Real>(config: ModelConfig, mut root: Builder<'_, T>) -> Self {
        config.check().unwrap_or_else(|message| panic!("{message}"));
        let vggt = Vggt::new(root.scope_here(), config.vggt());
        let features = FeatureHead::new(root.scope("gaussian_param_head"), config.feature_head());
        let stereo =
            config.dense.stereo.map(|sizes| Stereo::new(&mut root.scope("stereo"), sizes, config.dense.channels));
        let mut head = root.scope("gaussian_param_head");
        let guidance = config
            .gaussians
            .frequency_prior
            .then(|| Guidance::new(&mut head, config.wavelet(), config.dense.guidance_hidden, config.dense.channels));
        let head = CardinalityHead::new(head.scope("gs_moe"), config.head());
        Self { config, vggt, features, guidance, head, stereo }
    }

    /// The dense network in it: backbone, camera head and depth head.
    pub fn vggt(&self) -> &Vggt {
        &self.vggt
    }

    /// The configuration that the model was built with.
    pub fn config(&self) -> &ModelConfig {
        &self.config
    }

    /// Runs backbone and camera head on photos `[B, V, 3, H, W]` in [0, 1], which gives tokens and cameras.
    pub fn encode<'t, T: Real>(&self, cx: Context<'t, '_, T>, photos: Var<'t, T>) -> Encoded<'t, T> {
        self.vggt.encode(cx, photos)
    }

    /// Runs the dense heads and the router on scene `b` of the encoded scenes, whose photos are `[V, 3, H, W]`.
    ///
    /// Without recording, views are processed one after the other, so that full-resolution maps of only one view at a
    /// time are in memory.
    pub fn dense<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        encoded: &Encoded<'t, T>,
        b: usize,
        photos: Var<'t, T>,
    ) -> Dense<'t, T> {
        let [views, height, width] = [photos.shape()[0], photos.shape()[2], photos.shape()[3]];
        let pool = cx.tape.pool();
        let parts = if cx.tape.is_recording() {
            self.dense_views(cx, encoded, b, 0, photos)
        } else {
            pool.trim::<T>();
            let (pixels, plane) = (views * height * width, height * width);
            let [channels, experts] = [self.config.dense.channels, self.config.gaussians.experts()];
            let widths = [1, 1, channels, experts];
            let mut all = widths.map(|width| pool.buffer(pixels * width));
            cx.tape.for_each(0..views, |view| {
                let parts = self.dense_views(cx, encoded, b, view, photos.slice(0, view, 1));
                for ((all, part), width) in all.iter_mut().zip(parts).zip(widths) {
                    all[view * plane * width..][..plane * width].copy_from_slice(&part.value());
                }
            });
            pool.trim::<T>();
            let [depth, confidence, features, logits] = all;
            [
                cx.tape.constant_of(depth, [views, height, width]),
                cx.tape.constant_of(confidence, [views, height, width]),
                cx.tape.constant_of(features, [pixels, channels]),
                cx.tape.constant_of(logits, [pixels, experts]),
            ]
        };
        let [depth, confidence, features, logits] = parts;
        let wavelet = self.config.wavelet();
        let map = pool.table((wavelet, [height, width]), || EnergyMap::<T>::new(wavelet, [height, width]));
        let energy = cx.tape.constant_with([logits.shape()[0]], |e| map.compute(&photos.value(), pool, e));
        Dense { depth, confidence, features, logits, energy }
    }

    /// Depth, confidence, expert features as rows and logits of the views `photos` `[V, 3, H, W]`, which begin with
    /// view `first` of scene `b`.
    fn dense_views<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        encoded: &Encoded<'t, T>,
        b: usize,
        first: usize,
        photos: Var<'t, T>,
    ) -> [Var<'t, T>; 4] {
        let [views, height, width] = [photos.shape()[0], photos.shape()[2], photos.shape()[3]];
        let maps = self.vggt.depth(cx, encoded, b, [first, views], [height, width]);
        let seen = || {
            let layers = encoded.view_tokens(b, first, views);
            self.features.forward(cx, encoded.dense_tokens(&layers, [height, width]), photos)
        };
        let routed = |pixels: PixelFeatures<'t, T>| {
            let routed = match &self.guidance {
                Some(guidance) => pixels.features + pixels.embedding * guidance.forward(cx, photos),
                None => pixels.features,
            };
            (pixels.features, self.head.router.forward(cx, pixel_rows(routed)))
        };
        let (features, logits) = cx.part("gaussian_param_head", || {
            cx.tape.steps(seen).then(routed).then(|(features, logits)| (pixel_rows(features), logits)).end()
        });
        [maps.depth, maps.confidence, features, logits]
    }

    /// Predicts the Gaussians of a scene whose photos are `[V, 3, H, W]`.
    ///
    /// Depth is unprojected with `cameras` (viewmats `[V, 3, 4]`, intrinsics `[V, 4]`), `allocation` decides how many
    /// Gaussians each pixel gets, with noise from `stream`, and the experts' output is decoded.
    pub fn gaussians<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        dense: &Dense<'t, T>,
        photos: Var<'t, T>,
        cameras: &CameraVars<'t, T>,
        allocation: &dyn Allocation<T>,
        stream: Stream,
    ) -> PredictedGaussians<'t, T> {
        let [views, height, width] = [photos.shape()[0], photos.shape()[2], photos.shape()[3]];
        let pixels = views * height * width;
        let depth = self.stereo.as_ref().map_or(dense.depth, |stereo| {
            let offset = self.config.pixel_offset();
            cx.part("stereo", || stereo.forward(cx, photos, dense.features, dense.depth, cameras, offset))
        });
        let points = weaver_pose::unproject(depth, cameras.viewmats, cameras.intrinsics, self.config.pixel_offset());
        let in_footprints = !matches!(self.config.gaussians.parametrization, ParametrizationConfig::Published { .. });
        let footprints = in_footprints.then(|| {
            let focal = cameras.intrinsics.slice(1, 0, 1).reshape([views, 1, 1]).expand(depth.shape());
            (depth / focal).reshape([pixels])
        });
        let assignment = allocation.allocate(&AllocationRequest {
            logits: &dense.logits.value(),
            energy: &dense.energy.value(),
            photos: &photos.value(),
            depth: Some(&depth.value()),
            views,
            height,
            width,
            stream,
            inside: None,
            gumbel: None,
            pool: cx.tape.pool(),
        });
        let choice = assignment.choice(dense.logits, self.config.gaussians.temperature);
        let colors = in_footprints.then(|| pixel_rows(photos));
        let points = points.reshape([pixels, 3]);
        let inputs = PixelInputs { features: dense.features, points, footprints, colors, height, width };
        let PixelGaussians { gaussians, pixel } =
            cx.part("gaussian_param_head", || self.head.gaussians(cx, &inputs, &assignment, choice));
        PredictedGaussians { gaussians, depth, pixel, assignment, choice }
    }
}
