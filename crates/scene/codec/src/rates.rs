//! Bits of quantized numbers under a distribution, with derivatives.

use std::f64::consts::{LN_2, PI, SQRT_2};
use weaver_kernels::erf::erf_f64;

/// Least probability of a symbol.
pub const LEAST_PROBABILITY: f64 = 1e-6;

/// Least standard deviation.
const LEAST_DEVIATION: f64 = 1e-9;

/// Bits of a number under a normal distribution, and their derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaussianRate {
    /// `-log2 max(P, 1e-6)` with `P = Φ((x + Q/2 - m) / s) - Φ((x - Q/2 - m) / s)`.
    pub bits: f64,
    /// Derivative by `x`; that by the mean is its negative.
    pub by_x: f64,
    /// Derivative by `s`.
    pub by_deviation: f64,
    /// Derivative by `Q`.
    pub by_step: f64,
}

/// Bits and slope of a probability: below the least one the slope is that at the least one.
///
/// Descent on bits would raise the probability, so that its slope passes the bound (Ballé et al., 2018).
pub(crate) fn bits(probability: f64) -> (f64, f64) {
    let bounded = probability.max(LEAST_PROBABILITY);
    (-bounded.log2(), -1.0 / (bounded * LN_2))
}

/// Bits of a number `x`, rounded with step `Q`, under a normal distribution of mean `m` and standard deviation `s`, at
/// least 1e-9.
///
/// ```
/// use weaver_codec::gaussian_rate;
///
/// // Half of a normal distribution lies within 0.6745 deviations.
/// assert!((gaussian_rate(0.0, 0.0, 1.0, 2.0 * 0.674_489_75).bits - 1.0).abs() < 1e-6);
/// ```
pub fn gaussian_rate(x: f64, mean: f64, deviation: f64, step: f64) -> GaussianRate {
    let s = deviation.max(LEAST_DEVIATION);
    // Mirrored into the lower tail, where differences of Φ keep their digits.
    let distance = (x - mean).abs();
    let (upper, lower) = ((0.5 * step - distance) / s, (-0.5 * step - distance) / s);
    let density = |z: f64| (-0.5 * z * z).exp() / (2.0 * PI).sqrt();
    let probability = 0.5 * (erf_f64(upper / SQRT_2) - erf_f64(lower / SQRT_2));
    let (bits, slope) = bits(probability);
    let by_distance = slope * (density(lower) - density(upper)) / s;
    // z φ(z) vanishes at infinity, where the product would be NaN.
    let moment = |z: f64| if z.abs() > 40.0 { 0.0 } else { z * density(z) };
    let by_deviation = if deviation < LEAST_DEVIATION { 0.0 } else { slope * (moment(lower) - moment(upper)) / s };
    let by_step = slope * 0.5 * (density(upper) + density(lower)) / s;
    GaussianRate { bits, by_step, by_x: if x < mean { -by_distance } else { by_distance }, by_deviation }
}
