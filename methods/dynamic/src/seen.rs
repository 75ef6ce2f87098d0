//! Shots, and cached renders of frozen experts: with them, a router's step is a sparse product.

use std::sync::Arc;
use weaver_autograd::{Real, Var};
use weaver_pose::CameraVars;
use weaver_scene::{CameraSlices, Color, GaussianSlices, Groups, Model};
use weaver_splat::{
    BlendWeights, GaussianVars, Images, RasterError, RasterSettings, Workspace, WorkspacePool, rasterize,
};

/// One view at one time.
#[derive(Debug)]
pub struct Shot<'a, 't, T: Real> {
    /// The camera: viewmats `[1, 3, 4]`, intrinsics `[1, 4]`.
    pub camera: CameraVars<'t, T>,
    /// Time, 0 to 1.
    pub time: f64,
    /// H, W in pixels.
    pub size: [usize; 2],
    /// The color behind each expert, `[3]`.
    pub background: Var<'t, T>,
    /// The rules of drawing.
    pub settings: RasterSettings,
    /// Memory of the rasterizer.
    pub workspaces: &'a WorkspacePool<T>,
}

/// Renders of K frozen experts for one view at one time, P pixels: all inputs of a router's step, made by
/// [`PixelRouter::see`](crate::PixelRouter::see).
#[derive(Clone, Debug, PartialEq)]
pub struct Seen<T> {
    /// Each expert's picture `[K, P, 3]`.
    pub images: Vec<T>,
    /// Alpha of each expert `[K, P]`.
    pub alphas: Vec<T>,
    /// Weight of each Gaussian in each of the K P pixels.
    pub weights: Arc<BlendWeights<T>>,
}

impl<T: Real> Seen<T> {
    /// Draws the list of all Gaussians, each in the picture of its owner.
    pub(crate) fn of(
        gaussians: &GaussianVars<'_, T>,
        groups: Groups<'_>,
        shot: &Shot<'_, '_, T>,
        workspace: &mut Workspace<T>,
    ) -> Result<Self, RasterError> {
        let GaussianVars { means, quats, scales, opacities, colors } = *gaussians;
        let [means, quats, scales, opacities, colors] =
            [means, quats, scales, opacities, colors].map(|all| all.to_vec());
        let [viewmats, intrinsics, background] =
            [shot.camera.viewmats, shot.camera.intrinsics, shot.background].map(|all| all.to_vec());
        let [height, width] = shot.size;
        let pictures = groups.count * height * width;
        let gaussians = GaussianSlices {
            means: &means,
            quats: &quats,
            scales: &scales,
            opacities: &opacities,
            color: Color::Plain(&colors),
            features: None,
            groups: Some(groups),
        };
        let cameras = CameraSlices {
            viewmats: &viewmats,
            intrinsics: &intrinsics,
            background: &background,
            width,
            height,
            model: Model::Pinhole,
        };
        let (mut images, mut alphas) = (vec![T::ZERO; 3 * pictures], vec![T::ZERO; pictures]);
        let drawn = Images { image: &mut images, alpha: &mut alphas, depth: None, features: None };
        rasterize(&gaussians, &cameras, &shot.settings, workspace, drawn)?;
        Ok(Self { images, alphas, weights: Arc::new(BlendWeights::of(workspace)?) })
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.images) + size_of_val(&*self.alphas) + self.weights.bytes()
    }
}
