//! Whole numbers coded by a normal distribution that is known for each.

use crate::exact;
use crate::range::{Coder, Slices, WHOLE};

/// Numbers this far from the mean have a slice of their own; those beyond are coded by their distance.
const REACH: i32 = 40;
/// Slices: numbers within reach, and one for all beyond on either side.
const SYMBOLS: usize = 2 * REACH as usize + 3;
/// Largest magnitude of a number, its mean, and of the logarithm of its deviation.
const LARGEST: i32 = 1 << 24;
const LOGARITHM: f64 = 20.0;

/// Whole numbers under a normal distribution, integrated over each: they cost as much as by
/// [`gaussian_rate`](crate::gaussian_rate), but for the rounding to parts of 2^16 and at least one part for each within
/// 40 of the mean.
///
/// All arithmetic is exact in the sense that every machine gets the same bits, so that a decoder which predicts the
/// same distributions reads the same numbers.
///
/// ```
/// use weaver_codec::{CodeLength, GaussianModel, gaussian_rate};
///
/// let mut length = CodeLength::default();
/// GaussianModel::new(0.3, 2.0_f64.ln()).code(&mut length, 3);
/// assert!((length.bits - gaussian_rate(3.0, 0.3, 2.0, 1.0).bits).abs() < 0.02);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct GaussianModel {
    /// The number at the mean, and where the mean is beside it.
    center: i32,
    beside: f64,
    /// One over the deviation.
    narrow: f64,
}

impl GaussianModel {
    /// A distribution of this mean, and this natural logarithm of the standard deviation; both are clamped to the range
    /// of the coder, 2^24 and 20.
    pub fn new(mean: f64, log_deviation: f64) -> Self {
        let most = f64::from(LARGEST);
        let mean = if mean.is_nan() { 0.0 } else { mean.clamp(-most, most) };
        let logarithm = if log_deviation.is_nan() { 0.0 } else { log_deviation.clamp(-LOGARITHM, LOGARITHM) };
        let center = mean.round();
        Self { center: center as i32, beside: mean - center, narrow: exact::exp(-logarithm) }
    }

    /// Codes a number up to 2^24 in magnitude; larger ones are clamped.
    pub fn code(&self, coder: &mut impl Coder, number: i32) -> i32 {
        let distance = number.clamp(-LARGEST, LARGEST) - self.center;
        let symbol = (distance.clamp(-REACH - 1, REACH + 1) + REACH + 1) as usize;
        let found = coder.symbol(self, symbol) as i32 - REACH - 1;
        let far = match found.abs() {
            magnitude if magnitude > REACH => beyond(coder, distance.unsigned_abs().saturating_sub(REACH as u32 + 1)),
            _ => 0,
        };
        // A broken stream may say anything.
        (self.center + found + found.signum() * far as i32).clamp(-LARGEST, LARGEST)
    }

    /// Parts before a symbol.
    fn first(&self, symbol: usize) -> u32 {
        match symbol {
            0 => 0,
            SYMBOLS.. => WHOLE,
            _ => {
                let edge = (f64::from(symbol as i32 - 1 - REACH) - 0.5 - self.beside) * self.narrow;
                symbol as u32 + (below(edge) * f64::from(WHOLE - SYMBOLS as u32)) as u32
            }
        }
    }
}

impl Slices for GaussianModel {
    fn slice(&self, symbol: usize) -> (u32, u32) {
        let first = self.first(symbol);
        (first, self.first(symbol + 1) - first)
    }

    fn at(&self, part: u32) -> usize {
        // The last symbol that begins at the part or before.
        let (mut low, mut high) = (0, SYMBOLS);
        while high - low > 1 {
            let middle = low.midpoint(high);
            if self.first(middle) <= part { low = middle } else { high = middle }
        }
        low
    }
}

/// A number by its length, then its bits (Elias gamma).
fn beyond(coder: &mut impl Coder, number: u32) -> u32 {
    let number = number.saturating_add(1).min(1 << 26);
    let bits = coder.raw(5, number.ilog2()).min(26);
    ((1 << bits) | coder.raw(bits, number & !(1 << number.ilog2()))) - 1
}

/// The standard normal distribution function, within 1e-7 (Abramowitz and Stegun, 26.2.17), not falling.
fn below(z: f64) -> f64 {
    const SERIES: [f64; 5] = [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let far = z.abs().min(8.0);
    let t = 1.0 / (1.0 + 0.231_641_9 * far);
    let sum = SERIES.iter().rev().fold(0.0, |sum, c| (sum + c) * t);
    let above = exact::exp(-0.5 * far * far) * 0.398_942_280_401_432_7 * sum;
    if z < 0.0 { above } else { 1.0 - above }
}
