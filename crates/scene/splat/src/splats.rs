//! Gaussians of the last drawing as they are on the image, and the gradients with respect to these places.

use crate::error::RasterError;
use crate::ewa::{self, BITS, SUMS, slot};
use crate::tiles::{Record, moment, record};
use crate::workspace::Workspace;
use weaver_kernels::Real;

/// A Gaussian as one view sees it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Splat<T> {
    /// The projected mean, pixels.
    pub center: [T; 2],
    /// Three standard deviations along x and along y, pixels, the low-pass filter included.
    pub radii: [T; 2],
    /// Camera z of the mean, world units.
    pub depth: T,
}

/// Gradients with respect to the projected mean of a Gaussian in one view, per pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScreenGradient<T> {
    /// The gradient.
    pub plain: [T; 2],
    /// Sums of the absolute values of the pixels' contributions to it (Ye et al., AbsGS, 2024); `None` of a backward
    /// pass without statistics.
    pub absolute: Option<[T; 2]>,
}

impl<T: Real> Workspace<T> {
    /// The Gaussians of the last drawing on the image of each view, `[V, N]`; `None` for those that no tile looks at.
    ///
    /// # Errors
    ///
    /// A workspace that nothing was drawn with, or that drew through a lens.
    pub fn splats(&self) -> Result<Vec<Option<Splat<T>>>, RasterError> {
        self.of_each(|v, n| (!self.tiles.is_unseen(v, n)).then(|| Splat::of(self.tiles.record(v, n))))
    }

    /// The gradients of the last backward pass with respect to projected means, `[V, N]`; zeros for Gaussians that are
    /// not seen.
    ///
    /// # Errors
    ///
    /// A workspace without a backward pass since the last drawing, or that drew through a lens.
    pub fn screen_gradients(&self) -> Result<Vec<ScreenGradient<T>>, RasterError> {
        let statistics = self
            .differentiated
            .ok_or_else(|| RasterError::Arguments("nothing was differentiated since the last drawing".into()))?;
        self.of_each(|v, n| {
            let [p, q, r] = [slot::P, slot::Q, slot::R].map(|k| self.tiles.record(v, n).0[k]);
            let ([mut gu, mut gv], mut absolute) = ([T::ZERO; 2], [T::ZERO; 2]);
            for sums in self.tiles.entries(v, n) {
                gu += sums[ewa::moment::FIRST];
                gv += sums[ewa::moment::FIRST + 1];
                if statistics {
                    (0..2).for_each(|axis| absolute[axis] += sums[SUMS + moment::ABSOLUTE + axis]);
                }
            }
            if self.tiles.is_unseen(v, n) {
                return ScreenGradient { plain: [T::ZERO; 2], absolute: statistics.then_some([T::ZERO; 2]) };
            }
            // p, q, r and u, v both hold the factor BITS.
            let natural = T::from_f64(1.0 / (BITS * BITS));
            let plain = [natural * p * gu, natural * (q * gu + r * gv)].map(finite);
            ScreenGradient { plain, absolute: statistics.then(|| absolute.map(finite)) }
        })
    }

    fn of_each<R>(&self, of: impl Fn(usize, usize) -> R) -> Result<Vec<R>, RasterError> {
        let (extent, _) = self.last()?;
        if self.rays.is_some() {
            return Err(RasterError::Unsupported(
                "places of Gaussians on images are those of pinholes, found a lens".into(),
            ));
        }
        Ok((0..extent.views).flat_map(|v| (0..extent.gaussians).map(move |n| (v, n))).map(|(v, n)| of(v, n)).collect())
    }
}

impl<T: Real> Splat<T> {
    fn of(record: &Record<T>) -> Self {
        let numbers = &record.0;
        let [p, q, r] = [slot::P, slot::Q, slot::R].map(|k| numbers[k]);
        // S = L^-1 L^-T with L = [[p, q], [0, r]].
        let (a, b, c) = (T::ONE / p, q / (p * r), T::ONE / r);
        let three = T::from_f64(3.0 * BITS);
        Self {
            center: [numbers[slot::X], numbers[slot::Y]],
            radii: [three * (a * a + b * b).sqrt(), three * c],
            depth: numbers[record::DEPTH],
        }
    }
}

/// 0 for a number that is not finite.
fn finite<T: Real>(x: T) -> T {
    if x.is_finite() { x } else { T::ZERO }
}
