//! A rasterizer that is chosen while the program runs.

use crate::cpu_rasterizer::CpuRasterizer;
use crate::gradients::{Cotangents, Gradients};
use crate::rasterizer::{Images, RasterStats, Rasterizer};
use crate::resident::ResidentFit;
use crate::settings::{RasterError, RasterSettings};
use std::fmt::Debug;
use std::sync::Arc;
use weaver_kernels::Real;
use weaver_scene::{CameraSlices, GaussianSlices};

/// A rasterizer of any kind, chosen while the program runs: [`CpuRasterizer`] unless another is given. Cloning shares it.
///
/// What the trait [`Rasterizer`] says at compile time, this says at run time, so that who draws need not be generic over it.
///
/// ```
/// use weaver_splat::{AnyRasterizer, CpuRasterizer, WorkspacePool};
/// let chosen = AnyRasterizer::<f32>::new(CpuRasterizer);
/// let on_the_tape = WorkspacePool::of(chosen);
/// ```
#[derive(Clone, Debug)]
pub struct AnyRasterizer<T: Real>(Arc<dyn Choice<T>>);

/// The workspace of an [`AnyRasterizer`].
#[derive(Debug)]
pub struct AnyWorkspace<T: Real>(Box<dyn Drawing<T>>);

/// A rasterizer whose workspace is not named.
trait Choice<T: Real>: Debug + Send + Sync {
    fn drawing(self: Arc<Self>) -> Box<dyn Drawing<T>>;

    fn fit(&self) -> Option<Box<dyn ResidentFit>>;
}

/// A rasterizer with its workspace.
trait Drawing<T: Real>: Debug + Send {
    fn forward(
        &mut self,
        gaussians: &GaussianSlices<'_, T>,
        cameras: &CameraSlices<'_, T>,
        settings: &RasterSettings,
        images: Images<'_, T>,
    ) -> Result<RasterStats, RasterError>;

    fn backward(
        &mut self,
        gaussians: &GaussianSlices<'_, T>,
        cameras: &CameraSlices<'_, T>,
        settings: &RasterSettings,
        cotangents: &Cotangents<'_, T>,
        gradients: Gradients<'_, T>,
    ) -> Result<(), RasterError>;
}

#[derive(Debug)]
struct With<R, W> {
    rasterizer: Arc<R>,
    workspace: W,
}

impl<T: Real, R: Rasterizer<T>> Choice<T> for R {
    fn drawing(self: Arc<Self>) -> Box<dyn Drawing<T>> {
        Box::new(With { workspace: self.workspace(), rasterizer: self })
    }

    fn fit(&self) -> Option<Box<dyn ResidentFit>> {
        self.resident()
    }
}

impl<T: Real, R: Rasterizer<T>> Drawing<T> for With<R, R::Workspace> {
    fn forward(
        &mut self,
        gaussians: &GaussianSlices<'_, T>,
        cameras: &CameraSlices<'_, T>,
        settings: &RasterSettings,
        images: Images<'_, T>,
    ) -> Result<RasterStats, RasterError> {
        self.rasterizer.forward(gaussians, cameras, settings, &mut self.workspace, images)
    }

    fn backward(
        &mut self,
        gaussians: &GaussianSlices<'_, T>,
        cameras: &CameraSlices<'_, T>,
        settings: &RasterSettings,
        cotangents: &Cotangents<'_, T>,
        gradients: Gradients<'_, T>,
    ) -> Result<(), RasterError> {
        self.rasterizer.backward(gaussians, cameras, settings, &mut self.workspace, cotangents, gradients)
    }
}

impl<T: Real> AnyRasterizer<T> {
    /// This one.
    pub fn new(rasterizer: impl Rasterizer<T>) -> Self {
        Self(Arc::new(rasterizer))
    }
}

impl<T: Real> Default for AnyRasterizer<T> {
    fn default() -> Self {
        Self::new(CpuRasterizer)
    }
}

/// A workspace draws by the rasterizer that it was made by.
impl<T: Real> Rasterizer<T> for AnyRasterizer<T> {
    type Workspace = AnyWorkspace<T>;

    fn workspace(&self) -> AnyWorkspace<T> {
        AnyWorkspace(self.0.clone().drawing())
    }

    fn forward(
        &self,
        gaussians: &GaussianSlices<'_, T>,
        cameras: &CameraSlices<'_, T>,
        settings: &RasterSettings,
        workspace: &mut AnyWorkspace<T>,
        images: Images<'_, T>,
    ) -> Result<RasterStats, RasterError> {
        workspace.0.forward(gaussians, cameras, settings, images)
    }

    fn backward(
        &self,
        gaussians: &GaussianSlices<'_, T>,
        cameras: &CameraSlices<'_, T>,
        settings: &RasterSettings,
        workspace: &mut AnyWorkspace<T>,
        cotangents: &Cotangents<'_, T>,
        gradients: Gradients<'_, T>,
    ) -> Result<(), RasterError> {
        workspace.0.backward(gaussians, cameras, settings, cotangents, gradients)
    }

    fn resident(&self) -> Option<Box<dyn ResidentFit>> {
        self.0.fit()
    }
}
