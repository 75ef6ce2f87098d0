//! The statistics of Gaussians from the sums of a backward pass over the tiles.

use crate::ewa::{self, BITS, EwaGaussian, slot};
use crate::lens::{RayGaussian, factor_in_pixels};
use crate::statistics::GaussianStatistics;
use crate::tiles::{CHUNK, Record, Response, Tiles, moment};
use weaver_kernels::lanes::LANES;
use weaver_kernels::{Real, parallel};

/// A Gaussian that has a place and a size on the image.
pub(crate) trait OnImage<T>: Response {
    /// p, q and r of u = p dx + q dy and v = r dy, dx and dy in pixels, times [`BITS`], from the record.
    fn factor(&self, record: &Record<T>) -> [T; 3];
}

impl<T: Real> OnImage<T> for EwaGaussian {
    fn factor(&self, record: &Record<T>) -> [T; 3] {
        [slot::P, slot::Q, slot::R].map(|k| record.0[k])
    }
}

impl<T: Real> OnImage<T> for RayGaussian<'_, T> {
    fn factor(&self, record: &Record<T>) -> [T; 3] {
        factor_in_pixels(record)
    }
}

/// Adds the results of the last backward pass over `tiles` in `views` views, to one element per Gaussian.
pub(crate) fn accumulate<T: Real, P: OnImage<T>>(
    tiles: &Tiles<T>,
    views: usize,
    gaussian: &P,
    statistics: &mut [GaussianStatistics<T>],
) {
    parallel::for_chunks(statistics, CHUNK, |chunk, statistics| {
        for (i, statistics) in statistics.iter_mut().enumerate() {
            for v in 0..views {
                let n = chunk * CHUNK + i;
                statistics.add::<P>(gaussian.factor(tiles.record(v, n)), tiles.entries(v, n));
            }
        }
    });
}

impl<T: Real> GaussianStatistics<T> {
    /// Adds a view: p, q, r of the Gaussian and the sums over pixels of its entries.
    fn add<'a, P: Response>(&mut self, [p, q, r]: [T; 3], entries: impl Iterator<Item = &'a [T; LANES]>) {
        let zero = T::ZERO;
        let ([mut gu, mut gv], mut absolute, mut weight, mut largest) = ([zero; 2], [zero; 2], zero, zero);
        for sums in entries {
            gu += sums[ewa::moment::FIRST];
            gv += sums[ewa::moment::FIRST + 1];
            (0..2).for_each(|axis| absolute[axis] += sums[P::SUMS + moment::ABSOLUTE + axis]);
            weight += sums[P::SUMS + moment::WEIGHT];
            largest = largest.max(sums[P::SUMS + moment::LARGEST_WEIGHT]);
        }
        if weight <= zero {
            return;
        }
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

/// 0 for a number that is not finite.
fn finite<T: Real>(x: T) -> T {
    if x.is_finite() { x } else { T::ZERO }
}
