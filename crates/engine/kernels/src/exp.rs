//! Exponentials, binary logarithm and hyperbolic tangent in `f32`, without branches or calls, so that loops over them
//! vectorize inside [`simd::dispatch`](crate::simd::dispatch).
//!
//! e^x and tanh reduce x = n ln 2 + r with |r| <= ln 2 / 2, where ln 2 is split in two parts (Cody and Waite), and use
//! a polynomial for e^r - 1 that interpolates at Chebyshev nodes.

use crate::lanes::Vector;

/// Adding and subtracting 1.5 * 2^23 rounds to the nearest integer and leaves it in the low bits.
pub(crate) const ROUND: f32 = 12_582_912.0;

/// n and e^r - 1 with x = n ln 2 + r, for |x| < 2^15.
#[inline(always)]
fn reduce(x: f32) -> (i32, f32) {
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = -2.121_944_4e-4;
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = (x - n * LN_2_HIGH) - n * LN_2_LOW;
    let p = 0.001_392_618_4_f32;
    let p = p * r + 0.008_363_179;
    let p = p * r + 0.041_666_556;
    let p = p * r + 0.166_665_77;
    let p = p * r + 0.5;
    (shifted.to_bits() as i32 - ROUND.to_bits() as i32, r * r * p + r)
}

/// 2^n for -126 <= n <= 127.
#[inline(always)]
fn power_of_two(n: i32) -> f32 {
    f32::from_bits(((n + 127) << 23) as u32)
}

/// e^x in `f32`, within 1.1 units in the last place of the exact value where the result is a normal number.
///
/// Underflows gradually, overflows to infinity, and returns NaN for NaN.
///
/// ```
/// use weaver_kernels::exp::exp_f32;
/// assert_eq!(exp_f32(0.0), 1.0);
/// assert_eq!(exp_f32(f32::NEG_INFINITY), 0.0);
/// ```
#[inline(always)]
pub fn exp_f32(x: f32) -> f32 {
    // Beyond these limits the result is infinite or 0 anyway. Comparisons, unlike min and max, let NaN through.
    let x = if x > 89.0 { 89.0 } else { x };
    let x = if x < -104.0 { -104.0 } else { x };
    let (n, expm1) = reduce(x);
    // Two factors, since 2^n may be out of range.
    let half = n >> 1;
    (1.0 + expm1) * power_of_two(half) * power_of_two(n - half)
}

/// A polynomial of degree 5, constant term first.
#[derive(Clone, Copy)]
pub(crate) struct Quintic([f32; 6]);

impl Quintic {
    /// Evaluates the polynomial by Estrin's scheme: one multiplication more than Horner's, but half the latency.
    #[inline(always)]
    pub fn polynomial<V: Vector<Scalar = f32>>(self, x: V) -> V {
        let [c0, c1, c2, c3, c4, c5] = self.0;
        let square = x * x;
        let low = V::splat(c1).mul_add(x, V::splat(c0));
        let middle = V::splat(c3).mul_add(x, V::splat(c2));
        let high = V::splat(c5).mul_add(x, V::splat(c4));
        high.mul_add(square, middle).mul_add(square, low)
    }
}

/// Coefficients of 2^x on `[0, 1]`, relative error 8e-8 before rounding; 1 at 0.
#[cfg(target_arch = "x86_64")]
pub(crate) const EXP2_FLOOR: Quintic =
    Quintic([1.0, 0.693_151_3, 0.240_164_45, 0.055_799_91, 0.009_017_03, 0.001_867_13]);
/// Coefficients of 2^x on `[-0.5, 0.5]`, relative error 9e-8 before rounding; 1 at 0.
pub(crate) const EXP2_NEAREST: Quintic =
    Quintic([1.0, 0.693_146_94, 0.240_222_42, 0.055_507_34, 0.009_671_51, 0.001_326_47]);
/// Coefficients of t, t^3, .. t^9 in log2((1 + t) / (1 - t)) for |t| <= 0.2.
pub(crate) const LOG2_ODD: [f32; 5] = [2.885_39, 0.961_796_6, 0.577_093_94, 0.411_133_3, 0.349_416_76];

/// n and e^r with x = n ln 2 + r, for a [`Vector`] that can multiply by 2^n. Clamps x to where e^x is neither 0 nor
/// infinite; for NaN the result is an arbitrary number.
#[inline(always)]
pub(crate) fn reduced<V: Vector<Scalar = f32>>(x: V) -> (V, V) {
    use std::f64::consts::{LN_2, LOG2_E};
    let x = x.max(V::splat(-105.0)).min(V::splat(90.0));
    let shift = V::splat(ROUND);
    let n = x.mul_add(V::constant(LOG2_E), shift) - shift;
    // n times the upper bits of ln 2 is exact.
    let high = 0.693_359_375;
    let r = n.mul_add(V::constant(high - LN_2), n.mul_add(V::constant(-high), x));
    let mut e = V::constant(1.0 / 5040.0);
    for factorial in [720.0, 120.0, 24.0, 6.0, 2.0, 1.0, 1.0] {
        e = e.mul_add(r, V::constant(1.0 / factorial));
    }
    (n, e)
}

/// 2^x in `f32`, within 2.5 units in the last place of the exact value where the result is a normal number.
///
/// Underflows gradually, overflows to infinity, and returns NaN for NaN.
#[inline(always)]
pub fn exp2_f32(x: f32) -> f32 {
    let x = if x > 129.0 { 129.0 } else { x };
    let x = if x < -151.0 { -151.0 } else { x };
    let shifted = x + ROUND;
    let r = x - (shifted - ROUND);
    let [c0, c1, c2, c3, c4, c5] = EXP2_NEAREST.0;
    let p = ((((c5 * r + c4) * r + c3) * r + c2) * r + c1) * r + c0;
    let n = shifted.to_bits() as i32 - ROUND.to_bits() as i32;
    p * power_of_two(n >> 1) * power_of_two(n - (n >> 1))
}

/// Base-2 logarithm of a positive normal number in `f32`, within 4 units in the last place or 2^-23, whichever is
/// larger.
#[inline(always)]
pub fn log2_f32(x: f32) -> f32 {
    // x = 2^n m with m in [0.75, 1.5).
    let n = (x.to_bits() as i32).wrapping_sub(0.75_f32.to_bits() as i32) >> 23;
    let m = f32::from_bits(x.to_bits().wrapping_sub((n << 23) as u32));
    let t = (m - 1.0) / (m + 1.0);
    let square = t * t;
    let [c0, c1, c2, c3, c4] = LOG2_ODD;
    let p = (((c4 * square + c3) * square + c2) * square + c1) * square + c0;
    p * t + n as f32
}

/// tanh x in `f32`, within 1.3 units in the last place of the exact value; NaN for NaN.
#[inline(always)]
pub fn tanh_f32(x: f32) -> f32 {
    let a = x.abs();
    // Below 0.65, where a quotient would lose digits: a + a u P(u) with u = a^2.
    let u = a * a;
    let p = -0.005_923_726_f32;
    let p = p * u + 0.020_873_46;
    let p = p * u - 0.053_823_76;
    let p = p * u + 0.133_325_84;
    let p = p * u - 0.333_333_28;
    let small = a + a * (u * p);
    // Above: 1 - 2 / (e^{2a} + 1), which rounds to 1 from 9.02 on.
    let double = if a > 10.0 { 20.0 } else { 2.0 * a };
    let (n, expm1) = reduce(double);
    let scale = power_of_two(n);
    let large = 1.0 - 2.0 / (scale * expm1 + (scale + 1.0));
    (if a < 0.65 { small } else { large }).copysign(x)
}
