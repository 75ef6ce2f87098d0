//! The rasterizer on the device behind the trait for all.

use crate::backward::Backward;
use crate::context::Context;
use crate::fit::GpuFit;
use crate::forward::Forward;
use crate::profile::Profile;
use crate::workspace::GpuWorkspace;
use weaver_scene::{CameraSlices, GaussianSlices};
use weaver_splat::{
    Cotangents, Extent, Gradients, Images, RasterError, RasterSettings, RasterStats, Rasterizer, ResidentFit,
};

/// Draws and differentiates on an open device by the rules of [`weaver_splat::rasterize`]. Cloning shares the device.
///
/// Image, alpha and depth are within 1e-4 of the CPU's, gradients within 1e-4 of their norm, but for pixels where rounding
/// decides whether an alpha reaches 1/255 or a transmittance 1e-4. All inputs have gradients, and there are statistics for density
/// control. The same call has the same bits every time on one adapter. Features are drawn on the CPU only, and
/// [`RasterStats`] has no counts of pairs.
///
/// ```no_run
/// use weaver_gpu::{Choice, Context, GpuRasterizer};
/// use weaver_splat::{AnyRasterizer, WorkspacePool};
/// let rasterizer = GpuRasterizer::new(Context::open(&Choice::Fastest)?);
/// let on_the_tape = WorkspacePool::<f32>::of(AnyRasterizer::new(rasterizer)); // for weaver_splat::Rasterize
/// # Ok::<(), weaver_gpu::GpuError>(())
/// ```
#[derive(Clone, Debug)]
pub struct GpuRasterizer {
    context: Context,
    measured: bool,
}

impl GpuRasterizer {
    /// A rasterizer on this device.
    pub fn new(context: Context) -> Self {
        Self { context, measured: false }
    }

    /// Measures every pass, for [`GpuWorkspace::pass_times`]. It waits for each submission, which costs time.
    pub fn measured(mut self) -> Self {
        self.measured = true;
        self
    }

    /// The device.
    pub fn context(&self) -> &Context {
        &self.context
    }
}

impl Rasterizer<f32> for GpuRasterizer {
    type Workspace = GpuWorkspace;

    fn workspace(&self) -> GpuWorkspace {
        let profile = if self.measured { Profile::new(&self.context) } else { None };
        GpuWorkspace { profile, ..GpuWorkspace::default() }
    }

    fn resident(&self) -> Option<Box<dyn ResidentFit>> {
        Some(Box::new(GpuFit::new(self.context.clone(), self.workspace())))
    }

    fn forward(
        &self,
        gaussians: &GaussianSlices<'_, f32>,
        cameras: &CameraSlices<'_, f32>,
        settings: &RasterSettings,
        workspace: &mut GpuWorkspace,
        images: Images<'_, f32>,
    ) -> Result<RasterStats, RasterError> {
        let extent = Extent::of(gaussians, cameras, settings, images.depth.is_some())?;
        extent.check_images(&images)?;
        if gaussians.features.is_some_and(|features| features.channels > 0) {
            return Err(RasterError::new("features are drawn on the CPU only"));
        }
        if gaussians.groups.is_some() {
            return Err(RasterError::new("groups are drawn on the CPU only"));
        }
        workspace.drawn = None;
        let forward = Forward::new(&self.context, (gaussians, cameras, settings, &extent), workspace);
        let stats = forward.run(images)?;
        workspace.drawn = Some((extent, *settings));
        Ok(stats)
    }

    fn backward(
        &self,
        gaussians: &GaussianSlices<'_, f32>,
        cameras: &CameraSlices<'_, f32>,
        settings: &RasterSettings,
        workspace: &mut GpuWorkspace,
        cotangents: &Cotangents<'_, f32>,
        gradients: Gradients<'_, f32>,
    ) -> Result<(), RasterError> {
        let depth = workspace.drawn.is_some_and(|(extent, _)| extent.depth);
        let extent = Extent::of(gaussians, cameras, settings, depth)?;
        if workspace.drawn != Some((extent, *settings)) {
            return Err(RasterError::new("backward needs the workspace of a forward with the same sizes and settings"));
        }
        extent.check_backward(cameras, cotangents, &gradients)?;
        let backward = Backward::new(&self.context, (gaussians, cameras, settings, &extent), workspace);
        Ok(backward.run(cotangents, gradients)?)
    }
}
