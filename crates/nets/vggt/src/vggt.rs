//! The whole of VGGT: from photos to cameras and depth.

use crate::{
    Aggregator, AggregatorConfig, BackboneInit, CameraHead, CameraHeadConfig, DenseTokens, DepthHead, DepthHeadConfig,
    DepthMaps,
};
use weaver_autograd::{List, Real, Var};
use weaver_nn::{Builder, Context};
use weaver_pose::CameraVars;

/// Sizes and initial values of a [`CameraNetwork`].
#[derive(Clone, Debug, PartialEq)]
pub struct CameraNetworkConfig {
    /// Patch encoder and aggregator.
    pub aggregator: AggregatorConfig,
    /// Initial values of patch encoder and aggregator.
    pub init: BackboneInit,
    /// Camera head; its tokens are twice as wide as the aggregator's.
    pub camera_head: CameraHeadConfig,
    /// Added to the tangent of half the field of view where focal lengths are decoded: 0 in VGGT, 1e-3 in SplatWeaver.
    pub tangent_offset: f64,
}

/// Sizes and initial values of a [`Vggt`].
#[derive(Clone, Debug, PartialEq)]
pub struct VggtConfig {
    /// Backbone and camera head.
    pub cameras: CameraNetworkConfig,
    /// Depth head, which reads the aggregator's layers.
    pub depth_head: DepthHeadConfig,
}

/// The part of VGGT that says where photos were taken: patch encoder, aggregator and camera head.
#[derive(Clone, Debug)]
pub struct CameraNetwork {
    aggregator: Aggregator,
    camera_head: CameraHead,
    tangent_offset: f64,
}

/// VGGT (Wang et al. 2025, arXiv 2503.11651): patch encoder, aggregator, camera head and depth head.
///
/// Parameter names follow its checkpoints.
#[derive(Clone, Debug)]
pub struct Vggt {
    cameras: CameraNetwork,
    depth_head: DepthHead,
}

/// The outputs of backbone and camera head for B scenes of V views.
#[derive(Clone, Debug)]
pub struct Encoded<'t, T: Real = f32> {
    /// Tokens `[B, V, T, 2 D]` of the levels that feed the dense heads, four of them where there are any.
    pub tokens: List<Var<'t, T>>,
    /// Tokens of a view before its first patch.
    special: usize,
    /// Rows and columns of patches.
    grid: [usize; 2],
    /// Pose codes `[B, V, 9]` of every refinement, in the frame of the camera head's own choice; quaternions of any
    /// length.
    pub raw: List<Var<'t, T>>,
    /// Pose codes `[B, V, 9]` of every refinement as emitted, in the frame that the camera head's configuration says.
    pub codes: List<Var<'t, T>>,
    /// The cameras of the last refinement: viewmats `[B, V, 3, 4]`, intrinsics `[B, V, 4]`.
    pub cameras: CameraVars<'t, T>,
}

impl<'t, T: Real> Encoded<'t, T> {
    /// The cameras of scene `b`: viewmats `[V, 3, 4]`, intrinsics `[V, 4]`.
    pub fn scene_cameras(&self, b: usize) -> CameraVars<'t, T> {
        CameraVars { viewmats: entry(self.cameras.viewmats, b), intrinsics: entry(self.cameras.intrinsics, b) }
    }

    /// The tokens of some views of scene `b`, one `[views, T, 2 D]` for each level.
    pub fn view_tokens(&self, b: usize, first: usize, count: usize) -> List<Var<'t, T>> {
        let of_views = |tokens: &Var<'t, T>| {
            let scene = entry(*tokens, b);
            if count == scene.shape()[0] { scene } else { scene.slice(0, first, count) }
        };
        self.tokens.iter().map(of_views).collect()
    }

    /// Levels as a dense head reads them.
    pub fn dense_tokens<'a>(&self, layers: &'a [Var<'t, T>], image: [usize; 2]) -> DenseTokens<'a, 't, T> {
        DenseTokens { layers, special: self.special, grid: self.grid, image }
    }
}

/// Entry `b` of the first dimension.
fn entry<T: Real>(x: Var<'_, T>, b: usize) -> Var<'_, T> {
    let rest = x.shape();
    let one = if rest[0] == 1 { x } else { x.slice(0, b, 1) };
    one.reshape(&rest.dims()[1..])
}

impl CameraNetwork {
    /// Adds the parameters `aggregator` and `camera_head`.
    pub fn new<T: Real>(root: &mut Builder<'_, T>, config: CameraNetworkConfig) -> Self {
        Self {
            aggregator: Aggregator::new(root.scope("aggregator"), config.aggregator, config.init),
            camera_head: CameraHead::new(root.scope("camera_head"), config.camera_head),
            tangent_offset: config.tangent_offset,
        }
    }

    /// Photos `[B, V, 3, H, W]` in `[0, 1]` to tokens and cameras.
    pub fn encode<'t, T: Real>(&self, cx: Context<'t, '_, T>, photos: Var<'t, T>) -> Encoded<'t, T> {
        let shape = photos.shape();
        let [height, width] = [shape[3], shape[4]];
        let aggregated = cx.part("aggregator", || self.aggregator.forward(cx, photos));
        let estimates = cx.part("camera_head", || self.camera_head.forward(cx, aggregated.camera));
        let raw = estimates.iter().map(|e| e.raw).collect();
        let codes: List<_> = estimates.iter().map(|e| e.code).collect();
        let last = *codes.last().expect("a camera head has at least one iteration");
        let cameras = weaver_pose::cameras_with(last, [height, width], self.tangent_offset);
        let (special, grid) = (aggregated.special, aggregated.grid);
        Encoded { tokens: aggregated.layers.into_iter().collect(), special, grid, raw, codes, cameras }
    }
}

impl Vggt {
    /// The patch encoder alone: tokens `[T, rows columns, D]` of photos `[T, 3, H, W]` in `[0, 1]`, before any
    /// attention across views.
    pub fn patches<'t, T: Real>(&self, cx: Context<'t, '_, T>, photos: Var<'t, T>) -> Var<'t, T> {
        cx.part("aggregator", || self.cameras.aggregator.patches(cx, photos))
    }

    /// Adds the parameters `aggregator`, `camera_head` and `depth_head`.
    pub fn new<T: Real>(mut root: Builder<'_, T>, config: VggtConfig) -> Self {
        Self {
            cameras: CameraNetwork::new(&mut root, config.cameras),
            depth_head: DepthHead::new(root.scope("depth_head"), config.depth_head),
        }
    }

    /// Backbone and camera head: photos `[B, V, 3, H, W]` in `[0, 1]` to tokens and cameras.
    pub fn encode<'t, T: Real>(&self, cx: Context<'t, '_, T>, photos: Var<'t, T>) -> Encoded<'t, T> {
        self.cameras.encode(cx, photos)
    }

    /// Depth and confidence of `count` views of scene `b` from the view `first` on, images of `image` (H, W).
    pub fn depth<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        encoded: &Encoded<'t, T>,
        b: usize,
        [first, count]: [usize; 2],
        image: [usize; 2],
    ) -> DepthMaps<'t, T> {
        cx.part("depth_head", || {
            let layers = encoded.view_tokens(b, first, count);
            self.depth_head.forward(cx, encoded.dense_tokens(&layers, image))
        })
    }
}
