//! Exponential and hyperbolic tangent in `f32`, without branches or calls, so that loops over them
//! vectorise inside [`simd::dispatch`](crate::simd::dispatch).
//!
//! Both reduce x = n ln 2 + r with |r| <= ln 2 / 2 (ln 2 in two parts, after Cody and Waite) and use a
//! polynomial for e^r - 1 that interpolates at Chebyshev nodes.

/// Adding and subtracting 1.5 * 2^23 rounds to the nearest integer and leaves it in the low bits.
const ROUND: f32 = 12_582_912.0;

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

/// e^x in `f32`, within 1.2 units in the last place of the exact value where the result is a normal
/// number; gradual underflow, overflow to infinity, NaN stays NaN.
///
/// ```
/// use weaver_kernels::exp::exp_f32;
/// assert_eq!(exp_f32(0.0), 1.0);
/// assert_eq!(exp_f32(f32::NEG_INFINITY), 0.0);
/// ```
#[inline(always)]
pub fn exp_f32(x: f32) -> f32 {
    // Beyond these the result is infinite or 0 anyway. Comparisons, not min and max, let NaN through.
    let x = if x > 89.0 { 89.0 } else { x };
    let x = if x < -104.0 { -104.0 } else { x };
    let (n, expm1) = reduce(x);
    // Two factors, since 2^n itself may be out of range.
    let half = n >> 1;
    (1.0 + expm1) * power_of_two(half) * power_of_two(n - half)
}

/// tanh x in `f32`, within 2.5 units in the last place of the exact value.
#[inline(always)]
pub fn tanh_f32(x: f32) -> f32 {
    // tanh |x| = (e^{2|x|} - 1) / (e^{2|x|} + 1), and it rounds to 1 from 9.02 on.
    let double = 2.0 * x.abs();
    let double = if double > 19.0 { 19.0 } else { double };
    let (n, expm1) = reduce(double);
    let scale = power_of_two(n);
    let e = scale * expm1 + (scale - 1.0);
    (e / (e + 2.0)).copysign(x)
}
