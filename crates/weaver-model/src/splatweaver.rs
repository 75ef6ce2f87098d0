//! The network: photos in, cameras and Gaussians out.

use crate::{ModelConfig, ParametrisationKind};
use weaver_autograd::{List, Params, Real, Var};
use weaver_kernels::random::Stream;
use weaver_nn::{Builder, Context};
use weaver_pose::{CameraHead, Cameras};
use weaver_router::{Allocation, AllocationRequest, Assignment, CardinalityHead, Gaussians, PixelInputs};
use weaver_vggt::{Aggregator, DenseTokens, DepthHead, FeatureHead};
use weaver_wavelet::{EnergyMap, Guidance};

/// SplatWeaver: a handful of unposed photos to cameras and a compact set of Gaussians.
///
/// Source: Wan et al., SplatWeaver, arXiv 2605.07287. Parameter names are those of the official checkpoint, without the
/// leading `encoder.`.
#[derive(Clone, Debug)]
pub struct SplatWeaver {
    config: ModelConfig,
    aggregator: Aggregator,
    camera_head: CameraHead,
    depth_head: DepthHead,
    features: FeatureHead,
    guidance: Option<Guidance>,
    head: CardinalityHead,
}

/// What the backbone and the camera head say about B scenes of V views.
#[derive(Clone, Debug)]
pub struct Encoded<'t, T: Real = f32> {
    /// Tokens `[B, V, T, 2 D]` of the four levels that feed the dense heads.
    pub tokens: List<Var<'t, T>>,
    /// Tokens of a view before its first patch.
    special: usize,
    /// Rows and columns of patches.
    grid: [usize; 2],
    /// Pose codes `[B, V, 9]` of every refinement, in the frame of the camera head's own choice; quaternions of any
    /// length.
    pub raw: List<Var<'t, T>>,
    /// Pose codes `[B, V, 9]` of every refinement as emitted, in the frame that the configuration's gauge says.
    pub codes: List<Var<'t, T>>,
    /// The cameras of the last refinement: w2c `[B, V, 3, 4]`, intrinsics `[B, V, 4]`.
    pub cameras: Cameras<'t, T>,
}

/// What the dense heads say about one scene: everything before pixels are given their Gaussians.
#[derive(Clone, Copy, Debug)]
pub struct Dense<'t, T: Real = f32> {
    /// Depth `[V, H, W]`.
    pub depth: Var<'t, T>,
    /// Confidence in it, at least 1 `[V, H, W]`.
    pub confidence: Var<'t, T>,
    /// Expert features F as rows `[P, C]`.
    features: Var<'t, T>,
    /// The router's logits `[P, E]`.
    pub logits: Var<'t, T>,
    /// Wavelet energy `[P]`; a constant.
    pub energy: Var<'t, T>,
}

/// A scene of Gaussians, and how pixels were given theirs.
#[derive(Debug)]
pub struct Woven<'t, T: Real = f32> {
    /// The Gaussians, in the frame of the cameras that they were made with.
    pub gaussians: Gaussians<'t, T>,
    /// How many Gaussians each pixel got.
    pub assignment: Assignment<T>,
    /// The straight-through choice `[P, E]` where the router made it.
    pub choice: Option<Var<'t, T>>,
}

impl<'t, T: Real> Encoded<'t, T> {
    /// The cameras of scene `b`: w2c `[V, 3, 4]`, intrinsics `[V, 4]`.
    pub fn scene_cameras(&self, b: usize) -> Cameras<'t, T> {
        Cameras { w2c: entry(self.cameras.w2c, b), intrinsics: entry(self.cameras.intrinsics, b) }
    }
}

/// Entry `b` of the first dimension.
fn entry<T: Real>(x: Var<'_, T>, b: usize) -> Var<'_, T> {
    let rest = x.shape();
    let one = if rest[0] == 1 { x } else { x.slice(0, b, 1) };
    one.reshape(&rest.dims()[1..])
}

/// Maps `[V, C, H, W]` as rows of pixels `[V H W, C]`.
fn pixel_rows<T: Real>(maps: Var<'_, T>) -> Var<'_, T> {
    let s = maps.shape();
    maps.permute(&[0, 2, 3, 1]).reshape([s[0] * s[2] * s[3], s[1]])
}

impl SplatWeaver {
    /// Adds the parameters of a new model, drawn from `seed`.
    ///
    /// # Panics
    /// If the configuration does not pass [`ModelConfig::check`].
    pub fn new<T: Real>(config: ModelConfig, params: &mut Params<T>, seed: u64) -> Self {
        config.check().unwrap_or_else(|message| panic!("{message}"));
        let mut root = Builder::new(params, seed);
        let aggregator = Aggregator::new(root.scope("aggregator"), config.aggregator(), config.backbone_init());
        let camera_head = CameraHead::new(root.scope("camera_head"), config.camera_head());
        let depth_head = DepthHead::new(root.scope("depth_head"), config.depth_head());
        let features = FeatureHead::new(root.scope("gaussian_param_head"), config.feature_head());
        let mut gaussians = root.scope("gaussian_param_head");
        let guidance = config
            .gaussians
            .frequency_prior
            .then(|| Guidance::new(&mut gaussians, config.wavelet(), config.dense.wave, config.dense.channels));
        let head = CardinalityHead::new(gaussians.scope("gs_moe"), config.head());
        Self { config, aggregator, camera_head, depth_head, features, guidance, head }
    }

    /// The configuration that it was built with.
    pub fn config(&self) -> &ModelConfig {
        &self.config
    }

    /// Backbone and camera head: photos `[B, V, 3, H, W]` in `[0, 1]` to tokens and cameras.
    pub fn encode<'t, T: Real>(&self, cx: Context<'t, '_, T>, photos: Var<'t, T>) -> Encoded<'t, T> {
        let shape = photos.shape();
        let [height, width] = [shape[3], shape[4]];
        let aggregated = {
            let _scope = cx.scope("aggregator");
            self.aggregator.forward(cx, photos)
        };
        let estimates = {
            let _scope = cx.scope("camera_head");
            self.camera_head.forward(cx, aggregated.camera)
        };
        let raw = estimates.iter().map(|e| e.raw).collect();
        let codes: List<_> = estimates.iter().map(|e| e.code).collect();
        let last = *codes.last().expect("a camera head has at least one iteration");
        let cameras = weaver_pose::cameras(last, height, width);
        let (special, grid) = (aggregated.special, aggregated.grid);
        Encoded { tokens: aggregated.layers.into_iter().collect(), special, grid, raw, codes, cameras }
    }

    /// Dense heads and router on scene `b` of what was encoded; `photos` `[V, 3, H, W]` are that scene's.
    pub fn dense<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        encoded: &Encoded<'t, T>,
        b: usize,
        photos: Var<'t, T>,
    ) -> Dense<'t, T> {
        let [height, width] = [photos.shape()[2], photos.shape()[3]];
        let layers: List<_> = encoded.tokens.iter().map(|t| entry(*t, b)).collect();
        let tokens =
            DenseTokens { layers: &layers, special: encoded.special, grid: encoded.grid, image: [height, width] };
        let maps = {
            let _scope = cx.scope("depth_head");
            self.depth_head.forward(cx, tokens)
        };
        let _scope = cx.scope("gaussian_param_head");
        let pixels = self.features.forward(cx, tokens, photos);
        let routed = match &self.guidance {
            Some(guidance) => pixels.features + pixels.embedding * guidance.forward(cx, photos),
            None => pixels.features,
        };
        let logits = self.head.router.forward(cx, pixel_rows(routed));
        let (wavelet, pool) = (self.config.wavelet(), cx.tape.pool());
        let map = pool.table((wavelet, [height, width]), || EnergyMap::<T>::new(wavelet, [height, width]));
        let energy = cx.tape.constant_with([logits.shape()[0]], |e| map.compute(&photos.value(), pool, e));
        let features = pixel_rows(pixels.features);
        Dense { depth: maps.depth, confidence: maps.confidence, features, logits, energy }
    }

    /// Gives pixels their Gaussians: unprojects with `cameras` (w2c `[V, 3, 4]`, intrinsics `[V, 4]`), allocates, and
    /// decodes.
    pub fn weave<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        dense: &Dense<'t, T>,
        photos: Var<'t, T>,
        cameras: &Cameras<'t, T>,
        allocation: &dyn Allocation<T>,
        stream: Stream,
    ) -> Woven<'t, T> {
        let [views, height, width] = [photos.shape()[0], photos.shape()[2], photos.shape()[3]];
        let pixels = views * height * width;
        let centre = self.config.dense.pixel_centre;
        let points = weaver_pose::unproject(dense.depth, cameras.w2c, cameras.intrinsics, centre);
        let in_footprints = self.config.gaussians.parametrisation == ParametrisationKind::Footprint;
        let footprints = in_footprints.then(|| {
            let focal = cameras.intrinsics.slice(1, 0, 1).reshape([views, 1, 1]).expand(dense.depth.shape());
            (dense.depth / focal).reshape([pixels])
        });
        let assignment = allocation.allocate(&AllocationRequest {
            logits: &dense.logits.value(),
            energy: &dense.energy.value(),
            views,
            height,
            width,
            stream,
            gumbel: None,
            pool: cx.tape.pool(),
        });
        let choice = assignment.choice(dense.logits, self.config.gaussians.temperature);
        let colors = in_footprints.then(|| pixel_rows(photos));
        let points = points.reshape([pixels, 3]);
        let inputs = PixelInputs { features: dense.features, points, footprints, colors, height, width };
        let _scope = cx.scope("gaussian_param_head");
        let gaussians = self.head.gaussians(cx, &inputs, &assignment.expert, choice);
        Woven { gaussians, assignment, choice }
    }
}
