//! By-products of a backward pass, for density control and pruning.

use crate::ewa::{self, BITS, slot};
use crate::tiles::{CHUNK, Record, Tiles, moment};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use weaver_kernels::{Real, parallel};

/// What a backward pass learns about one Gaussian beside its gradient, summed over the views and over as many passes as it
/// is given to.
///
/// A Gaussian is seen by a view if it adds to at least one pixel of what is drawn of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GaussianStatistics<T> {
    /// Sum over the views of the length of the gradient with respect to the projected mean, per pixel: 3D Gaussian
    /// splatting splits by it (Kerbl et al., 2023, section 5.2).
    pub screen_gradient: T,
    /// Sum over the views of the length of (sum |dL/dx|, sum |dL/dy|), absolute values of what each pixel adds to the
    /// gradient with respect to the projected mean (x, y): large where a Gaussian is pulled apart, although the plain
    /// gradient may cancel (Ye et al., AbsGS, 2024).
    pub absgrad: T,
    /// Number of views that saw it.
    pub views: u32,
    /// Largest radius among the views that saw it, in pixels: three standard deviations of the longest axis on the image,
    /// the low-pass filter included.
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

    /// What the passes since the last call found, `[N]`; empty if there were none. The next pass starts from zero, with as
    /// many Gaussians as it has.
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

/// Adds what the last backward pass over `tiles` found in `views` views, to one element per Gaussian.
pub(crate) fn accumulate<T: Real>(tiles: &Tiles<T>, views: usize, statistics: &mut [GaussianStatistics<T>]) {
    parallel::for_chunks(statistics, CHUNK, |chunk, statistics| {
        for (i, statistics) in statistics.iter_mut().enumerate() {
            for v in 0..views {
                let n = chunk * CHUNK + i;
                statistics.add(tiles.record(v, n), tiles.entries(v, n));
            }
        }
    });
}

impl<T: Real> GaussianStatistics<T> {
    /// Adds a view: the record of the Gaussian and the sums over pixels of its entries.
    fn add<'a>(&mut self, record: &Record<T>, entries: impl Iterator<Item = &'a [T; 16]>) {
        let zero = T::ZERO;
        let ([mut gu, mut gv], mut absolute, mut weight, mut largest) = ([zero; 2], [zero; 2], zero, zero);
        for sums in entries {
            gu += sums[moment::SHAPE + ewa::moment::FIRST];
            gv += sums[moment::SHAPE + ewa::moment::FIRST + 1];
            (0..2).for_each(|axis| absolute[axis] += sums[moment::ABSOLUTE + axis]);
            weight += sums[moment::WEIGHT];
            largest = largest.max(sums[moment::LARGEST_WEIGHT]);
        }
        if weight <= zero {
            return;
        }
        let [p, q, r] = [slot::P, slot::Q, slot::R].map(|k| record.0[k]);
        // p, q, r and u, v both hold the factor BITS.
        let natural = T::from_f64(1.0 / (BITS * BITS));
        self.screen_gradient += finite(length([natural * p * gu, natural * (q * gu + r * gv)]));
        self.absgrad += finite(length(absolute));
        self.views += 1;
        self.radius = self.radius.max(finite(radius([p, q, r])));
        self.contribution += weight;
        self.largest_weight = self.largest_weight.max(largest);
    }
}

/// Three standard deviations of the longer axis of S, from the scaled Cholesky factor of its inverse.
fn radius<T: Real>([p, q, r]: [T; 3]) -> T {
    // S = L^-1 L^-T with L = [[p, q], [0, r]].
    let (a, b, c) = (T::ONE / p, q / (p * r), T::ONE / r);
    let half = T::from_f64(0.5);
    let (xx, xy, yy) = (a * a + b * b, b * c, c * c);
    let variance = half * (xx + yy) + length([half * (xx - yy), xy]);
    T::from_f64(3.0 * BITS) * variance.sqrt()
}

fn length<T: Real>([x, y]: [T; 2]) -> T {
    (x * x + y * y).sqrt()
}

/// 0 for what is not finite.
fn finite<T: Real>(x: T) -> T {
    if x.is_finite() { x } else { T::ZERO }
}
