//! Uniform quantizer with a dead zone, and the binary one.

/// Largest magnitude of a symbol that [`crate::MixedModel`] codes.
pub const LARGEST_SYMBOL: i32 = (1 << 24) - 1;

/// A uniform quantizer, `sign(x) ⌊|x| / Q + ½ - z⌋`.
///
/// The offset `z` makes small numbers zero, which costs less than their neighbors: the error is at most `Q (½ + z)`.
///
/// ```
/// use weaver_codec::Quantizer;
///
/// let quantizer = Quantizer { step: 0.5, dead_zone: 0.2 };
/// assert_eq!([0.34, 0.36, -1.1].map(|x| quantizer.symbol(x)), [0, 1, -2]);
/// assert_eq!(quantizer.value(-2), -1.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantizer {
    /// Distance `Q` of two values, in units of the numbers; positive.
    pub step: f64,
    /// Offset `z` of the rounding, in `[0, ½)`.
    pub dead_zone: f64,
}

impl Quantizer {
    /// The symbol of a number, up to 2^24 - 1 in magnitude: beyond that it is clamped. NaN is 0.
    pub fn symbol(&self, x: f64) -> i32 {
        let magnitude = (x.abs() / self.step + 0.5 - self.dead_zone).floor();
        let symbol = (magnitude as i32).min(LARGEST_SYMBOL);
        if x < 0.0 { -symbol } else { symbol }
    }

    /// The number that a symbol stands for.
    pub fn value(&self, symbol: i32) -> f64 {
        f64::from(symbol) * self.step
    }
}

/// The binary quantizer, 1 from zero on and -1 below.
pub fn binary(x: f64) -> f64 {
    if x < 0.0 { -1.0 } else { 1.0 }
}
