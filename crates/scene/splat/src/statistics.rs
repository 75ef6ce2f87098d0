//! By-products of a backward pass, for density control and pruning.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use weaver_kernels::Real;

/// Statistics of one Gaussian from a backward pass beside its gradient, summed over the views and over as many passes
/// as it is given to.
///
/// A Gaussian is seen by a view if it adds to at least one pixel of its drawing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GaussianStatistics<T> {
    /// Sum over the views of the length of the gradient with respect to the projected mean, per pixel: 3D Gaussian
    /// splatting splits by it (Kerbl et al., 2023, section 5.2).
    pub screen_gradient: T,
    /// Sum over the views of the length of (sum |dL/dx|, sum |dL/dy|), absolute values of the pixels' contributions to
    /// the gradient with respect to the projected mean (x, y): large where a Gaussian is pulled apart, although the
    /// plain gradient may cancel (Ye et al., AbsGS, 2024).
    pub absgrad: T,
    /// Number of views that saw it.
    pub views: u32,
    /// Largest radius among the views that saw it, in pixels: three standard deviations of the longest axis on the
    /// image, the low-pass filter included.
    pub radius: T,
    /// Sum of its blending weights alpha T over all pixels.
    pub contribution: T,
    /// Its largest blending weight at a pixel.
    pub largest_weight: T,
}

/// Statistics of all Gaussians `[N]` that backward passes on the tape add to. Cloning shares them.
///
/// [`Rasterize::with_statistics`](crate::Rasterize::with_statistics) fills them.
#[derive(Clone, Debug, Default)]
pub struct SharedStatistics<T> {
    gaussians: Arc<Mutex<Vec<GaussianStatistics<T>>>>,
}

impl<T: Real> SharedStatistics<T> {
    /// Statistics of no pass.
    pub fn new() -> Self {
        Self { gaussians: Arc::default() }
    }

    /// Statistics of the passes since the last call, `[N]`; empty if there were none. The next pass starts from zero,
    /// with as many Gaussians as it has.
    pub fn take(&self) -> Vec<GaussianStatistics<T>> {
        std::mem::take(&mut self.gaussians.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// The statistics of `n` Gaussians, or of as many as passes added to since the last [`take`](Self::take).
    pub(crate) fn lock(&self, n: usize) -> MutexGuard<'_, Vec<GaussianStatistics<T>>> {
        let mut gaussians = self.gaussians.lock().unwrap_or_else(PoisonError::into_inner);
        if gaussians.is_empty() {
            gaussians.resize(n, GaussianStatistics::default());
        }
        gaussians
    }
}
