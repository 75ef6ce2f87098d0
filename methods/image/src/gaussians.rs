//! Gaussians of a picture, and their rescaling.

use crate::error::{ImageError, expect_len, range};
use weaver_kernels::Real;

/// The least standard deviation of fits, in pixels.
pub(crate) const LEAST_SCALE: f32 = 0.3;

/// A picture as a sum of N Gaussians.
///
/// The color of a point p is `C(p) = sum_i c_i exp(-d^T S_i^-1 d / 2)`, where `d = p - center_i` and
/// `S_i = R diag(s^2) R^T` with the rotation R by `angle_i`. There is neither order nor opacity. Displays clamp to [0,
/// 1]. The middle of pixel j is at j + 1/2. The same struct holds gradients, moments or rates of all numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians<T> {
    /// Centers `[N, 2]`, x and y in pixels.
    pub centers: Vec<T>,
    /// Standard deviations along both axes `[N, 2]`, pixels, positive.
    pub scales: Vec<T>,
    /// Angles from the x axis to the first axis `[N]`, radians, toward y, which points down.
    pub angles: Vec<T>,
    /// Colors `[N, 3]`, of any sign.
    pub colors: Vec<T>,
}

impl<T: Real> Gaussians<T> {
    /// `count` Gaussians of zeros: room for gradients.
    pub fn zeros(count: usize) -> Self {
        let zeros = |width: usize| vec![T::ZERO; count * width];
        Self { centers: zeros(2), scales: zeros(2), angles: zeros(1), colors: zeros(3) }
    }

    /// N, the number of Gaussians.
    pub fn len(&self) -> usize {
        self.angles.len()
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.angles.is_empty()
    }

    /// Appends a Gaussian.
    pub fn push(&mut self, center: [T; 2], scale: [T; 2], angle: T, color: [T; 3]) {
        self.centers.extend(center);
        self.scales.extend(scale);
        self.angles.push(angle);
        self.colors.extend(color);
    }

    /// Appends Gaussians.
    pub fn extend(&mut self, others: &Self) {
        self.centers.extend(&others.centers);
        self.scales.extend(&others.scales);
        self.angles.extend(&others.angles);
        self.colors.extend(&others.colors);
    }

    /// The Gaussians of these indices, in their order.
    pub(crate) fn some(&self, which: &[usize]) -> Self {
        let mut out = Self::default();
        for i in which.iter().copied() {
            let pair = |of: &[T]| [of[2 * i], of[2 * i + 1]];
            let color = [0, 1, 2].map(|c| self.colors[3 * i + c]);
            out.push(pair(&self.centers), pair(&self.scales), self.angles[i], color);
        }
        out
    }

    /// Checks that all lists have the same number of Gaussians.
    pub(crate) fn check_lengths(&self) -> Result<(), ImageError> {
        let count = self.len();
        expect_len("centers of Gaussians", self.centers.len(), 2 * count)?;
        expect_len("scales of Gaussians", self.scales.len(), 2 * count)?;
        expect_len("colors of Gaussians", self.colors.len(), 3 * count)
    }

    /// Checks lengths and values.
    ///
    /// # Errors
    /// Lengths that disagree, a scale that is not positive, a number that is not finite.
    pub fn check(&self) -> Result<(), ImageError> {
        self.check_lengths()?;
        if let Some(i) = self.scales.iter().position(|s| !(*s > T::ZERO && s.is_finite())) {
            return Err(range("scale of a Gaussian", "a positive number of pixels", self.scales[i]));
        }
        let others = [("center", &self.centers), ("angle", &self.angles), ("color", &self.colors)];
        for (what, numbers) in others {
            if let Some(x) = numbers.iter().find(|x| !x.is_finite()) {
                return Err(range("number of a Gaussian", format!("a finite {what}"), x));
            }
        }
        Ok(())
    }

    /// The same picture with sides `factor` times as long, filtered by the box of its pixels where it shrinks.
    ///
    /// With k the factor, `s'^2 = k^2 s^2 + max(0, 1 - k^2) / 12`: the added variance of averaging over the pixels
    /// under a new one. A Gaussian keeps its integral, so that its color is multiplied by `k^2 s_1 s_2 / (s'_1 s'_2)`.
    ///
    /// ```
    /// let mut picture = weaver_image::Gaussians::default();
    /// picture.push([10.0, 4.0], [2.0, 1.0], 0.0, [1.0; 3]);
    /// let half = picture.at_scale(0.5);
    /// assert_eq!(half.centers, [5.0, 2.0]);
    /// assert!(half.scales[0] > 1.0 && half.colors[0] < 1.0);
    /// ```
    pub fn at_scale(&self, factor: f64) -> Self {
        let mut out = self.clone();
        let k = T::from_f64(factor);
        out.centers.iter_mut().for_each(|x| *x *= k);
        for i in 0..self.len() {
            let mut gain = T::ONE;
            for s in &mut out.scales[2 * i..2 * i + 2] {
                let wide = widened(*s, factor);
                gain *= k * *s / wide;
                *s = wide;
            }
            out.colors[3 * i..3 * i + 3].iter_mut().for_each(|c| *c *= gain);
        }
        out
    }

    /// Turns gradients with respect to [`at_scale`](Self::at_scale) of these Gaussians into gradients with respect to
    /// themselves.
    pub fn pull_back(&self, factor: f64, gradient: &mut Self) {
        let k = T::from_f64(factor);
        gradient.centers.iter_mut().for_each(|x| *x *= k);
        for i in 0..self.len() {
            let scales = [self.scales[2 * i], self.scales[2 * i + 1]];
            let wide = scales.map(|s| widened(s, factor));
            let gain = k * k * scales[0] * scales[1] / (wide[0] * wide[1]);
            let mut by_gain = T::ZERO;
            for c in 3 * i..3 * i + 3 {
                gradient.colors[c] *= gain;
                by_gain += gradient.colors[c] * self.colors[c];
            }
            for (j, (s, wide)) in scales.into_iter().zip(wide).enumerate() {
                let slope = k * k * s / wide;
                let g = &mut gradient.scales[2 * i + j];
                *g = *g * slope + by_gain * (T::ONE / s - slope / wide);
            }
        }
    }
}

/// A standard deviation at another scale.
fn widened<T: Real>(s: T, factor: f64) -> T {
    let filter = (1.0 - factor * factor).max(0.0) / 12.0;
    T::from_f64((factor * s.to_f64()).powi(2) + filter).sqrt()
}
