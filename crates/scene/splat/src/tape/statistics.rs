//! Statistics of backward passes on the tape.

use crate::statistics::GaussianStatistics;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use weaver_kernels::Real;

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
    pub(super) fn lock(&self, n: usize) -> MutexGuard<'_, Vec<GaussianStatistics<T>>> {
        let mut gaussians = self.gaussians.lock().unwrap_or_else(PoisonError::into_inner);
        if gaussians.is_empty() {
            gaussians.resize(n, GaussianStatistics::default());
        }
        gaussians
    }
}
