//! The seam between rasterizers and their callers: any rasterizer, chosen while the program runs.

use crate::error::RasterError;
use crate::gradients::{Cotangents, Gradients};
use crate::settings::RasterSettings;
use std::fmt::Debug;
use std::sync::Arc;
use weaver_kernels::Real;
use weaver_scene::{CameraSlices, GaussianSlices};

/// Something that draws Gaussians and differentiates the images, on a processor or a graphics card.
///
/// [`Rasterize`](crate::Rasterize) is an operation on the tape for any of them. [`CpuRasterizer`](crate::CpuRasterizer)
/// is the implementation of this crate. All drawing happens in a [`Session`].
pub trait Rasterizer<T: Real>: Debug + Send + Sync {
    /// Starts a session: memory for one drawing at a time.
    fn session(&self) -> Box<dyn Session<T>>;
}

/// A rasterizer of any kind, shared.
///
/// ```
/// use std::sync::Arc;
/// use weaver_splat::{AnyRasterizer, CpuRasterizer, WorkspacePool};
/// let chosen: AnyRasterizer<f32> = Arc::new(CpuRasterizer);
/// let on_the_tape = WorkspacePool::of(chosen);
/// ```
pub type AnyRasterizer<T> = Arc<dyn Rasterizer<T>>;

/// Memory of a [`Rasterizer`] that is kept between calls: a forward pass leaves data for the backward pass in it.
///
/// Shapes are with the fields of [`GaussianSlices`], [`CameraSlices`], [`Images`] and [`Gradients`].
pub trait Session<T: Real>: Debug + Send {
    /// Draws: image, alpha, and, where there is room for them, depth and features.
    ///
    /// # Errors
    ///
    /// Arguments that do not fit together, or more than the implementation can draw.
    fn forward(
        &mut self,
        gaussians: &GaussianSlices<'_, T>,
        cameras: &CameraSlices<'_, T>,
        settings: &RasterSettings,
        images: Images<'_, T>,
    ) -> Result<RasterStats, RasterError>;

    /// Gradients with respect to everything that [`forward`](Self::forward) was given, and by-products of finding them.
    ///
    /// All other arguments are the same as in the last forward of this session.
    ///
    /// # Errors
    ///
    /// Arguments that do not fit together, or a last forward with other sizes or settings.
    fn backward(
        &mut self,
        gaussians: &GaussianSlices<'_, T>,
        cameras: &CameraSlices<'_, T>,
        settings: &RasterSettings,
        cotangents: &Cotangents<'_, T>,
        gradients: Gradients<'_, T>,
    ) -> Result<(), RasterError>;
}

/// Output images. `H` and `W` are the sizes of the drawn region. Of Gaussians in K groups each is `[V, K, ..]`.
#[derive(Debug)]
pub struct Images<'a, T> {
    /// sum of w c + T background, `[V, H, W, 3]`; empty for Gaussians without colors.
    pub image: &'a mut [T],
    /// 1 - T, `[V, H, W]`.
    pub alpha: &'a mut [T],
    /// sum of w z, camera z in world units, not divided by alpha, `[V, H, W]`;
    /// [`expected_depth`](crate::expected_depth) divides.
    pub depth: Option<&'a mut [T]>,
    /// sum of w f, `[V, H, W, C]`.
    pub features: Option<&'a mut [T]>,
}

/// Statistics of a drawing, summed over the views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RasterStats {
    /// Gaussians that some tile looks at; their outlines touch the image, or come near its edge.
    pub splats: usize,
    /// Splats over tiles: the entries of all tile lists.
    pub entries: usize,
    /// Gaussians left out because they hold, or lead to, numbers that are not finite, or have a quaternion of zero.
    pub rejected: usize,
    /// Splats over pixels that they add to.
    pub pairs: u64,
    /// Pixels at which splats were evaluated, including ones that a splat leaves alone.
    pub evaluated: u64,
}
