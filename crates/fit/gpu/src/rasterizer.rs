//! The rasterizer on the device behind the trait for all.

use crate::backward::Backward;
use crate::context::Context;
use crate::fit::GpuFit;
use crate::forward::Forward;
use crate::profile::Profile;
use crate::workspace::GpuWorkspace;
use weaver_fit::{DeviceFit, FitRasterizer};
use weaver_scene::{CameraSlices, GaussianSlices};
use weaver_splat::{
    Cotangents, Extent, Gradients, Images, RasterError, RasterSettings, RasterStats, Rasterizer, Session,
};

/// Draws and differentiates on an open device by the rules of [`weaver_splat::rasterize`]. Cloning shares the device.
///
/// Image, alpha and depth are within 1e-4 of the CPU's, gradients within 1e-4 of their norm, but for pixels where
/// rounding decides whether an alpha reaches 1/255 or a transmittance 1e-4. All inputs have gradients, and there are
/// statistics for density control. The same call has the same bits every time on one adapter. Features are drawn on the
/// CPU only, and [`RasterStats`] has no counts of pairs.
///
/// ```no_run
/// use weaver_gpu::{Choice, Context, GpuRasterizer};
/// use std::sync::Arc;
/// use weaver_splat::WorkspacePool;
/// let rasterizer = GpuRasterizer::new(Context::open(&Choice::Fastest)?);
/// let on_the_tape = WorkspacePool::<f32>::of(Arc::new(rasterizer)); // for weaver_splat::Rasterize
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

impl GpuRasterizer {
    /// An empty workspace, for [`forward`](Self::forward) and [`backward`](Self::backward).
    pub fn workspace(&self) -> GpuWorkspace {
        let profile = if self.measured { Profile::new(&self.context) } else { None };
        GpuWorkspace { profile, ..GpuWorkspace::default() }
    }

    /// Draws as [`Session::forward`] does, in a workspace whose measurements can be read.
    ///
    /// # Errors
    ///
    /// Arguments that do not fit together, more than the device can draw, or a device that fails.
    pub fn forward(
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
            return Err(RasterError::Unsupported("features are drawn on the CPU only".into()));
        }
        if gaussians.groups.is_some() {
            return Err(RasterError::Unsupported("groups are drawn on the CPU only".into()));
        }
        workspace.drawn = None;
        let forward = Forward::new(&self.context, (gaussians, cameras, settings, &extent), workspace);
        let stats = forward.run(images)?;
        workspace.drawn = Some((extent, *settings));
        Ok(stats)
    }

    /// Differentiates as [`Session::backward`] does, in the workspace of the last forward.
    ///
    /// # Errors
    ///
    /// Arguments that do not fit together, a workspace whose last forward had other sizes or settings, or a device that
    /// fails.
    pub fn backward(
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
            return Err(RasterError::Arguments(
                "backward needs the workspace of a forward with the same sizes and settings".into(),
            ));
        }
        extent.check_backward(cameras, cotangents, &gradients)?;
        let backward = Backward::new(&self.context, (gaussians, cameras, settings, &extent), workspace);
        Ok(backward.run(cotangents, gradients)?)
    }
}

impl Rasterizer<f32> for GpuRasterizer {
    fn session(&self) -> Box<dyn Session<f32>> {
        Box::new(GpuSession::new(self))
    }
}

impl FitRasterizer for GpuRasterizer {
    fn device_fit(&self) -> Option<Box<dyn DeviceFit>> {
        Some(Box::new(GpuFit::new(self.context.clone(), self.workspace())))
    }
}

/// A session on the device: a workspace, and the rasterizer that it belongs to.
#[derive(Debug)]
pub struct GpuSession {
    rasterizer: GpuRasterizer,
    /// The memory of the session, with its measurements.
    pub workspace: GpuWorkspace,
}

impl GpuSession {
    /// A session of this rasterizer.
    pub fn new(rasterizer: &GpuRasterizer) -> Self {
        Self { workspace: rasterizer.workspace(), rasterizer: rasterizer.clone() }
    }
}

impl Session<f32> for GpuSession {
    fn forward(
        &mut self,
        gaussians: &GaussianSlices<'_, f32>,
        cameras: &CameraSlices<'_, f32>,
        settings: &RasterSettings,
        images: Images<'_, f32>,
    ) -> Result<RasterStats, RasterError> {
        self.rasterizer.forward(gaussians, cameras, settings, &mut self.workspace, images)
    }

    fn backward(
        &mut self,
        gaussians: &GaussianSlices<'_, f32>,
        cameras: &CameraSlices<'_, f32>,
        settings: &RasterSettings,
        cotangents: &Cotangents<'_, f32>,
        gradients: Gradients<'_, f32>,
    ) -> Result<(), RasterError> {
        self.rasterizer.backward(gaussians, cameras, settings, &mut self.workspace, cotangents, gradients)
    }
}
