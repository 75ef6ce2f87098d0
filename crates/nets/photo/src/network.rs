//! The network: compared photos to depth with uncertainty, and to Gaussians.

mod pyramid;

use crate::config::PhotoConfig;
use crate::kept::DepthMaps;
use crate::prior::{Prior, padded};
use pyramid::{Pyramid, cropped, joined, pixel_rows};
use weaver_autograd::{Buffer, Params, Real, Var};
use weaver_experts::{CardinalityHead, PixelGaussians, PixelInputs};
use weaver_geometry::Camera;
use weaver_kernels::random::Stream;
use weaver_model::Guidance;
use weaver_nn::{Builder, Context, Conv2d, WeightInit};
use weaver_pose::CameraVars;
use weaver_router::{Allocation, AllocationRequest, Assignment, Masked};
use weaver_scene::CameraRows;
use weaver_splat::GaussianVars;
use weaver_wavelet::EnergyMap;

/// Numbers of a pixel's depth: correction, trust, spread.
const DEPTH: usize = 3;
/// Logarithm of the odds of the depth of comparison at confidence 0, and what a confidence of 1 adds.
const TRUST: [f64; 2] = [-3.0, 6.0];
/// Logarithm of the spread at confidence 0, and what a confidence of 1 adds: 20 % and 2 %.
const SPREAD: [f64; 2] = [-1.6, -2.3];
/// Bound on the absolute value of log depth over the scale.
const LIMIT: f64 = 4.0;
/// Factor on the odds of opacity: a raw 0, with which training begins, is an opacity of 0.9, as surfaces are opaque.
const ODDS: f64 = 9.0;
/// Where in a pixel its ray passes.
const CENTER: f64 = 0.5;

/// A network for 2 to 16 photos of any size, whose cameras are known and whose depth has been compared ([`Prior`]).
///
/// Convolutions at five sizes and attention at the smallest, within each photo and, by their cameras, across all. Depth
/// is that of comparison where it is sure and corrected elsewhere, with the spread of a Laplacian: l = l0 + (1 - g) d
/// and g = sigmoid(-3 + 6 c + t), with l0 the log depth and c the confidence of the prior, d and t predicted. Router
/// and experts are SplatWeaver's ([`CardinalityHead`]); the features that they see include the spread and the
/// confidence. All last layers begin at zero: the untrained network is the photos' colors on the depth of comparison.
///
/// Parameters `pyramid` and `features`, `depth`, `gaussians` (as `gs_moe` in SplatWeaver), `guidance`.
#[derive(Clone, Debug)]
pub struct PhotoNetwork {
    config: PhotoConfig,
    pyramid: Pyramid,
    features: Conv2d,
    depth: Conv2d,
    guidance: Option<Guidance>,
    head: CardinalityHead,
}

/// All that is predicted of a scene's pixels before they are given Gaussians; V photos of H x W pixels, P in all.
#[derive(Clone, Copy, Debug)]
pub struct Dense<'t, T: Real = f32> {
    /// Log of depth over the scale `[V, H, W]`.
    pub log_depth: Var<'t, T>,
    /// Log of the spread of log depth: the mean absolute error that the network expects `[V, H, W]`.
    pub log_spread: Var<'t, T>,
    /// The router's logits `[P, E]`.
    pub logits: Var<'t, T>,
    /// Wavelet energy `[P]`; a constant.
    pub energy: Var<'t, T>,
    features: Var<'t, T>,
}

/// The Gaussians of a scene, in units of its scale, and how many each pixel was given.
#[derive(Debug)]
pub struct PhotoGaussians<'t, T: Real = f32> {
    /// The N Gaussians, in the frame of the cameras.
    pub gaussians: GaussianVars<'t, T>,
    /// The pixel that each Gaussian comes from `[N]`.
    pub pixel: Buffer<u32>,
    /// The number of Gaussians of each pixel.
    pub assignment: Assignment<T>,
    /// The straight-through choice `[P, E]`, if the router made it.
    pub choice: Option<Var<'t, T>>,
    /// The pixels `[P]` that could get Gaussians.
    pub kept: Vec<bool>,
}

impl PhotoNetwork {
    /// Adds the parameters of a new model with initial values drawn from `seed`.
    ///
    /// # Panics
    /// If the configuration does not pass [`PhotoConfig::check`].
    pub fn new<T: Real>(config: PhotoConfig, params: &mut Params<T>, seed: u64) -> Self {
        Self::build(config, Builder::new(params, seed))
    }

    /// Declares the parameters of a model whose values will be loaded.
    ///
    /// # Panics
    /// If the configuration does not pass [`PhotoConfig::check`].
    pub fn declare<T: Real>(config: PhotoConfig, params: &mut Params<T>) -> Self {
        Self::build(config, Builder::declaring(params))
    }

    fn build<T: Real>(config: PhotoConfig, mut root: Builder<'_, T>) -> Self {
        config.check().unwrap_or_else(|message| panic!("{message}"));
        let (full, g) = (config.channels[0], &config.gaussians);
        let guidance = g
            .frequency_prior
            .then(|| Guidance::new(&mut root.scope("guidance"), g.wavelet.wavelet(), full, config.features));
        Self {
            pyramid: Pyramid::new(&mut root.scope("pyramid"), &config),
            // Spread and confidence are the last two features.
            features: Conv2d::new(root.scope("features"), full, config.features - 2, 3, WeightInit::FanIn),
            depth: Conv2d::new(root.scope("depth"), full, DEPTH, 3, WeightInit::Zero),
            guidance,
            head: CardinalityHead::new(root.scope("gaussians"), config.gaussians.head(config.features)),
            config,
        }
    }

    /// The configuration that the model was built with.
    pub fn config(&self) -> &PhotoConfig {
        &self.config
    }

    /// Depth, features and logits of photos `[V, 3, H, W]` with their prior.
    pub fn dense<'t, T: Real>(&self, cx: Context<'t, '_, T>, prior: &Prior, photos: Var<'t, T>) -> Dense<'t, T> {
        let (views, size) = (prior.views(), prior.size);
        let [height, width] = size;
        let maps = cx.part("pyramid", || {
            let shape = [views, crate::CHANNELS, padded(height), padded(width)];
            let cameras = weaver_pose::projections(&camera_vars(cx, &prior.cameras), size);
            self.pyramid.forward(cx, constant(cx, &prior.input, &shape), cameras)
        });
        let maps = cropped(maps.gelu(), size);
        let map = |values: &[f32]| constant(cx, values, &[views, 1, height, width]);
        let (found, sure) = (map(&prior.log_depth), map(&prior.confidence));
        let raw = self.depth.forward(cx, maps);
        let trust = (raw.slice(1, 1, 1) + sure * TRUST[1] + TRUST[0]).sigmoid();
        let log_depth = (found + (trust * -1.0 + 1.0) * raw.slice(1, 0, 1)).clamp(-LIMIT, LIMIT);
        let log_spread = raw.slice(1, 2, 1) + sure * SPREAD[1] + SPREAD[0];
        let features = joined(&[self.features.forward(cx, maps), log_spread, sure]);
        let routed = self
            .guidance
            .as_ref()
            .map_or(features, |guidance| features + features * cx.part("guidance", || guidance.forward(cx, photos)));
        let logits = cx.part("gaussians", || self.head.router.forward(cx, pixel_rows(routed)));
        let (pool, wavelet) = (cx.tape.pool(), self.config.gaussians.wavelet.wavelet());
        let map = pool.table((wavelet, size), || EnergyMap::<T>::new(wavelet, size));
        let energy = cx.tape.constant_with([views * height * width], |e| map.compute(&photos.value(), pool, e));
        let [log_depth, log_spread] = [log_depth, log_spread].map(|x| x.reshape([views, height, width]));
        Dense { log_depth, log_spread, logits, energy, features: pixel_rows(features) }
    }

    /// The Gaussians of photos `[V, 3, H, W]`, in units of the prior's scale: one set for each place, where the photo
    /// that shows it best does ([`DepthMaps::kept`]).
    ///
    /// `allocation` decides how many Gaussians each pixel that is kept gets, with noise from `stream`; those outside of
    /// `inside` `[V, H, W]` get none.
    pub fn gaussians<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        (dense, prior): (&Dense<'t, T>, &Prior),
        photos: Var<'t, T>,
        inside: Option<&[bool]>,
        allocation: &dyn Allocation<T>,
        stream: Stream,
    ) -> PhotoGaussians<'t, T> {
        let [height, width] = prior.size;
        let views = prior.views();
        let pixels = views * height * width;
        let kept = {
            let narrow = |x: Var<'t, T>| x.value().iter().map(|x| x.to_f64() as f32).collect::<Vec<f32>>();
            let (log_depth, log_spread) = (narrow(dense.log_depth), narrow(dense.log_spread));
            let maps = DepthMaps { log_depth: &log_depth, log_spread: &log_spread, cameras: &prior.cameras, inside };
            maps.kept()
        };
        let cameras = camera_vars(cx, &prior.cameras);
        let depth = dense.log_depth.exp();
        let points = weaver_pose::unproject(depth, cameras.viewmats, cameras.intrinsics, CENTER);
        let focal = cameras.intrinsics.slice(1, 0, 1).reshape([views, 1, 1]).expand(depth.shape());
        let allocation = Masked { among: allocation, inside: Some(&kept) };
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
        let inputs = PixelInputs {
            features: dense.features,
            points: points.reshape([pixels, 3]),
            footprints: Some((depth / focal).reshape([pixels])),
            colors: Some(pixel_rows(photos)),
            height,
            width,
        };
        let PixelGaussians { gaussians, pixel } =
            cx.part("gaussians", || self.head.gaussians(cx, &inputs, &assignment, choice));
        let opacities = gaussians.opacities * ODDS / (gaussians.opacities * (ODDS - 1.0) + 1.0);
        let gaussians = GaussianVars { opacities, ..gaussians };
        PhotoGaussians { gaussians, pixel, assignment, choice, kept }
    }
}

/// Cameras as constants on the tape.
pub fn camera_vars<'t, T: Real>(cx: Context<'t, '_, T>, cameras: &[Camera]) -> CameraVars<'t, T> {
    let rows = CameraRows::new(cameras);
    CameraVars {
        viewmats: constant(cx, &rows.viewmats, &[cameras.len(), 3, 4]),
        intrinsics: constant(cx, &rows.intrinsics, &[cameras.len(), 4]),
    }
}

/// Numbers as a constant of the tape's type.
fn constant<'t, T: Real>(cx: Context<'t, '_, T>, values: &[f32], shape: &[usize]) -> Var<'t, T> {
    cx.tape.constant_with(shape, |to: &mut [T]| {
        to.iter_mut().zip(values).for_each(|(to, x)| *to = T::from_f64(f64::from(*x)));
    })
}
