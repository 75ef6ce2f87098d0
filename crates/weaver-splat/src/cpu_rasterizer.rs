//! The rasterizer of this crate behind the trait for all.

use crate::gradients::{Cotangents, Gradients};
use crate::rasterize::rasterize;
use crate::rasterize_backward::rasterize_backward;
use crate::rasterizer::{Images, RasterStats, Rasterizer};
use crate::settings::{RasterError, RasterSettings};
use crate::workspace::Workspace;
use weaver_kernels::Real;
use weaver_scene::{CameraSlices, GaussianSlices};

/// The rasterizer of this crate, on the threads of the processor: [`rasterize`](crate::rasterize()) and
/// [`rasterize_backward`](crate::rasterize_backward()).
#[derive(Clone, Copy, Debug, Default)]
pub struct CpuRasterizer;

impl<T: Real> Rasterizer<T> for CpuRasterizer {
    type Workspace = Workspace<T>;

    fn workspace(&self) -> Workspace<T> {
        Workspace::new()
    }

    fn forward(
        &self,
        gaussians: &GaussianSlices<'_, T>,
        cameras: &CameraSlices<'_, T>,
        settings: &RasterSettings,
        workspace: &mut Workspace<T>,
        images: Images<'_, T>,
    ) -> Result<RasterStats, RasterError> {
        rasterize(gaussians, cameras, settings, workspace, images)
    }

    fn backward(
        &self,
        gaussians: &GaussianSlices<'_, T>,
        cameras: &CameraSlices<'_, T>,
        settings: &RasterSettings,
        workspace: &mut Workspace<T>,
        cotangents: &Cotangents<'_, T>,
        gradients: Gradients<'_, T>,
    ) -> Result<(), RasterError> {
        rasterize_backward(gaussians, cameras, settings, workspace, cotangents, gradients)
    }
}
