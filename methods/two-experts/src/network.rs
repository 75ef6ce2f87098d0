//! 2Xplat: a network that estimates cameras, and one that makes Gaussians from photos with cameras.

use crate::{Opacities, Pyramid, TwoExpertsConfig};
use weaver_autograd::{Outputs, Params, Real, Var};
use weaver_nn::{Builder, Context};
use weaver_pose::CameraVars;
use weaver_splat::GaussianVars;
use weaver_vggt::{CameraNetwork, Encoded};

/// 2Xplat (Jeong et al., arXiv 2603.21064): a geometry expert and an appearance expert, with cameras as their only
/// link.
///
/// The geometry expert is VGGT's backbone with its camera head. It may also see target photos, from which the
/// appearance expert makes no Gaussians. Gradients of pictures flow back into it through the cameras. Parameters
/// `aggregator` and `camera_head`, as in VGGT, and `appearance`.
#[derive(Clone, Debug)]
pub struct TwoExperts {
    config: TwoExpertsConfig,
    geometry: CameraNetwork,
    appearance: Pyramid,
}

/// One Gaussian for each pixel of V photos, and its depth.
#[derive(Clone, Copy, Debug)]
pub struct PixelGaussians<'t, T: Real = f32> {
    /// V H W Gaussians, in the frame of the input cameras; a view-dependent opacity stands here as its mean over all
    /// directions.
    pub gaussians: GaussianVars<'t, T>,
    /// Opacities as functions of the view direction.
    pub opacities: Opacities<'t, T>,
    /// Depth along the optical axis `[V, H, W]`.
    pub depth: Var<'t, T>,
}

impl<T: Real> Outputs<T> for PixelGaussians<'_, T> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        let Self { gaussians, opacities, depth } = self;
        gaussians.for_each_var(visit);
        opacities.for_each_var(visit);
        visit(*depth);
    }
}

impl<'t, T: Real> PixelGaussians<'t, T> {
    /// The Gaussians as a camera at `center` `[3]` sees them.
    pub fn seen_from(&self, center: Var<'t, T>) -> GaussianVars<'t, T> {
        GaussianVars { opacities: self.opacities.seen_from(self.gaussians.means, center), ..self.gaussians }
    }

    /// The Gaussians of the pixels selected by `kept` `[V H W]`; depth stays complete.
    #[must_use]
    pub fn kept(&self, kept: &[bool]) -> Self {
        Self { gaussians: self.gaussians.kept(kept), opacities: self.opacities.kept(kept), ..*self }
    }
}

impl TwoExperts {
    /// Adds the parameters of a new model with initial values drawn from `seed`.
    ///
    /// # Panics
    /// If the configuration does not pass [`TwoExpertsConfig::check`].
    pub fn new<T: Real>(config: TwoExpertsConfig, params: &mut Params<T>, seed: u64) -> Self {
        Self::build(config, Builder::new(params, seed))
    }

    /// Declares the parameters of a model whose values will be loaded.
    ///
    /// # Panics
    /// If the configuration does not pass [`TwoExpertsConfig::check`].
    pub fn declare<T: Real>(config: TwoExpertsConfig, params: &mut Params<T>) -> Self {
        Self::build(config, Builder::declaring(params))
    }

    fn build<T: Real>(config: TwoExpertsConfig, mut root: Builder<'_, T>) -> Self {
        config.check().unwrap_or_else(|message| panic!("{message}"));
        let geometry = CameraNetwork::new(&mut root, config.camera_network());
        let appearance = Pyramid::new(root.scope("appearance"), config.pyramid());
        Self { config, geometry, appearance }
    }

    /// The configuration of the model.
    pub fn config(&self) -> &TwoExpertsConfig {
        &self.config
    }

    /// The geometry expert: photos `[B, N, 3, H, W]` in [0, 1] to their cameras, in the frame of the first.
    pub fn cameras<'t, T: Real>(&self, cx: Context<'t, '_, T>, photos: Var<'t, T>) -> Encoded<'t, T> {
        self.geometry.encode(cx, photos)
    }

    /// The appearance expert: photos `[V, 3, H, W]` with their `cameras` (viewmats `[V, 3, 4]`, intrinsics `[V, 4]`) to
    /// Gaussians.
    pub fn gaussians<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        photos: Var<'t, T>,
        cameras: &CameraVars<'t, T>,
    ) -> PixelGaussians<'t, T> {
        cx.part("appearance", || {
            let (raw, _) = self.appearance.forward(cx, photos, cameras);
            let (gaussians, depth) = raw.gaussians(self.config.parametrization(), cameras.intrinsics, photos);
            PixelGaussians { gaussians, opacities: raw.opacities(), depth }
        })
    }
}
