//! Vectors of eight `f32` in two NEON registers. NEON has twice as many registers as AVX2, half as wide, so that
//! kernels which fit one fit the other.
//!
//! NEON belongs to every 64-bit ARM processor that Rust compiles for by default.

use super::eight::{self, Eight, WIDTH};
use super::{LANES, LaneMask, Vector, sealed::Sealed};
use std::arch::aarch64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

#[derive(Clone, Copy)]
pub struct Quads(float32x4_t, float32x4_t);

/// All bits of a lane, or none.
#[derive(Clone, Copy)]
pub struct Mask(uint32x4_t, uint32x4_t);

impl Sealed for Quads {}

/// Defines methods whose bodies are expressions of intrinsics.
macro_rules! methods {
    ($(fn $name:ident($($arg:tt)*) -> $out:ty = $body:expr;)*) => {$(
        #[inline(always)]
        #[allow(unsafe_code)]
        fn $name($($arg)*) -> $out {
            // SAFETY: NEON is available, see the module.
            unsafe { $body }
        }
    )*};
}

macro_rules! operator {
    ($trait:ident $method:ident $intrinsic:ident) => {
        impl $trait for Quads {
            type Output = Self;
            methods! {
                fn $method(self, other: Self) -> Self =
                    Self($intrinsic(self.0, other.0), $intrinsic(self.1, other.1));
            }
        }
    };
}
operator!(Add add vaddq_f32);
operator!(Sub sub vsubq_f32);
operator!(Mul mul vmulq_f32);
operator!(Div div vdivq_f32);

impl Neg for Quads {
    type Output = Self;
    methods! {
        fn neg(self) -> Self = Self(vnegq_f32(self.0), vnegq_f32(self.1));
    }
}

/// The bits of the lanes, of the first four and of the last.
#[inline(always)]
#[allow(unsafe_code)]
fn bits_of_lanes() -> [uint32x4_t; 2] {
    const BITS: [u32; WIDTH] = [1, 2, 4, 8, 16, 32, 64, 128];
    // SAFETY: there are eight numbers.
    unsafe { [vld1q_u32(BITS.as_ptr()), vld1q_u32(BITS.as_ptr().add(4))] }
}

impl LaneMask for Mask {
    methods! {
        fn from_bits(bits: u16) -> Self = {
            let (bits, [low, high]) = (vdupq_n_u32(u32::from(bits)), bits_of_lanes());
            Self(vtstq_u32(bits, low), vtstq_u32(bits, high))
        };
        fn bits(self) -> u16 = {
            let [low, high] = bits_of_lanes();
            vaddvq_u32(vorrq_u32(vandq_u32(self.0, low), vandq_u32(self.1, high))) as u16
        };
        fn and(self, other: Self) -> Self = Self(vandq_u32(self.0, other.0), vandq_u32(self.1, other.1));
        fn and_not(self, other: Self) -> Self = Self(vbicq_u32(self.0, other.0), vbicq_u32(self.1, other.1));
        fn or(self, other: Self) -> Self = Self(vorrq_u32(self.0, other.0), vorrq_u32(self.1, other.1));
    }
}

/// The bits of `x` that are set in `mask`.
#[inline(always)]
#[allow(unsafe_code)]
fn masked(x: float32x4_t, mask: uint32x4_t) -> float32x4_t {
    // SAFETY: NEON is available, see the module.
    unsafe { vreinterpretq_f32_u32(vandq_u32(vreinterpretq_u32_f32(x), mask)) }
}

/// The bits of both.
#[inline(always)]
#[allow(unsafe_code)]
fn joined(x: float32x4_t, y: float32x4_t) -> float32x4_t {
    // SAFETY: NEON is available, see the module.
    unsafe { vreinterpretq_f32_u32(vorrq_u32(vreinterpretq_u32_f32(x), vreinterpretq_u32_f32(y))) }
}

impl Vector for Quads {
    type Scalar = f32;
    type Mask = Mask;
    const WIDTH: usize = WIDTH;

    methods! {
        fn splat(x: f32) -> Self = Self(vdupq_n_f32(x), vdupq_n_f32(x));
        fn mul_add(self, b: Self, c: Self) -> Self = Self(vfmaq_f32(c.0, self.0, b.0), vfmaq_f32(c.1, self.1, b.1));
        fn neg_mul_add(self, b: Self, c: Self) -> Self =
            Self(vfmsq_f32(c.0, self.0, b.0), vfmsq_f32(c.1, self.1, b.1));
        fn abs(self) -> Self = Self(vabsq_f32(self.0), vabsq_f32(self.1));
        fn sqrt(self) -> Self = Self(vsqrtq_f32(self.0), vsqrtq_f32(self.1));
        fn ge(self, other: Self) -> Mask = Mask(vcgeq_f32(self.0, other.0), vcgeq_f32(self.1, other.1));
        fn gt(self, other: Self) -> Mask = Mask(vcgtq_f32(self.0, other.0), vcgtq_f32(self.1, other.1));
        fn negative(self, mask: Mask) -> Self = {
            let sign = vdupq_n_f32(-0.0);
            Self(joined(self.0, masked(sign, mask.0)), joined(self.1, masked(sign, mask.1)))
        };
        fn or(self, mask: Mask, other: Self) -> Self =
            Self(vbslq_f32(mask.0, self.0, other.0), vbslq_f32(mask.1, self.1, other.1));
    }

    // The instruction for it would give NaN where `self` is NaN.
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.or(other.gt(self), other)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.or(self.gt(other), other)
    }
    #[inline(always)]
    fn only(self, mask: Mask) -> Self {
        Self(masked(self.0, mask.0), masked(self.1, mask.1))
    }
    #[inline(always)]
    #[allow(unsafe_code)]
    fn load_part(row: &[f32; LANES], part: usize) -> Self {
        let from = row.as_chunks::<WIDTH>().0[part].as_ptr();
        // SAFETY: the part has eight numbers.
        unsafe { Self(vld1q_f32(from), vld1q_f32(from.add(4))) }
    }
    #[inline(always)]
    #[allow(unsafe_code)]
    fn store_part(self, row: &mut [f32; LANES], part: usize) {
        let to = row.as_chunks_mut::<WIDTH>().0[part].as_mut_ptr();
        // SAFETY: the part has eight numbers.
        unsafe {
            vst1q_f32(to, self.0);
            vst1q_f32(to.add(4), self.1);
        }
    }

    eight::functions!();
}

impl Eight for Quads {
    methods! {
        fn round(self) -> Self = Self(vrndnq_f32(self.0), vrndnq_f32(self.1));
        fn with_exponent_from(self, shifted: Self) -> Self = {
            let scaled = |x: float32x4_t, shifted: float32x4_t| {
                let exponent = vshlq_n_s32::<23>(vreinterpretq_s32_f32(shifted));
                vreinterpretq_f32_s32(vaddq_s32(vreinterpretq_s32_f32(x), exponent))
            };
            Self(scaled(self.0, shifted.0), scaled(self.1, shifted.1))
        };
        fn power_of_two(self) -> Self = {
            let power = |n: float32x4_t| {
                let biased = vaddq_s32(vcvtnq_s32_f32(n), vdupq_n_s32(127));
                vreinterpretq_f32_s32(vshlq_n_s32::<23>(biased))
            };
            Self(power(self.0), power(self.1))
        };
        fn exponent(self) -> (Self, Self) = {
            let parts = |x: float32x4_t| {
                let (bits, least) = (vreinterpretq_s32_f32(x), vreinterpretq_s32_f32(vdupq_n_f32(0.75)));
                let n = vshrq_n_s32::<23>(vsubq_s32(bits, least));
                (vcvtq_f32_s32(n), vreinterpretq_f32_s32(vsubq_s32(bits, vshlq_n_s32::<23>(n))))
            };
            let ((n, m), (n_1, m_1)) = (parts(self.0), parts(self.1));
            (Self(n, n_1), Self(m, m_1))
        };
        fn sums(of: &[Self; WIDTH]) -> Self = {
            let sums = |of: &[Self]| {
                // Adds halves, then pairs, then neighbors.
                let pairs = |a: &Self, b: &Self| {
                    let (a, b) = (vaddq_f32(a.0, a.1), vaddq_f32(b.0, b.1));
                    vaddq_f32(vzip1q_f32(a, b), vzip2q_f32(a, b))
                };
                let (even, odd) = (pairs(&of[0], &of[2]), pairs(&of[1], &of[3]));
                vaddq_f32(vzip1q_f32(even, odd), vzip2q_f32(even, odd))
            };
            Self(sums(&of[..4]), sums(&of[4..]))
        };
        fn transposed(rows: [Self; WIDTH]) -> [Self; WIDTH] = {
            let [a, b, c, d, e, f, g, h] = rows;
            let block = |a, b, c, d| {
                let (even, odd) = (vzip1q_f32(a, c), vzip1q_f32(b, d));
                let (even_high, odd_high) = (vzip2q_f32(a, c), vzip2q_f32(b, d));
                [
                    vzip1q_f32(even, odd),
                    vzip2q_f32(even, odd),
                    vzip1q_f32(even_high, odd_high),
                    vzip2q_f32(even_high, odd_high),
                ]
            };
            let (upper, lower) = (block(a.0, b.0, c.0, d.0), block(e.0, f.0, g.0, h.0));
            let (upper_high, lower_high) = (block(a.1, b.1, c.1, d.1), block(e.1, f.1, g.1, h.1));
            let mut out = rows;
            for i in 0..4 {
                out[i] = Self(upper[i], lower[i]);
                out[4 + i] = Self(upper_high[i], lower_high[i]);
            }
            out
        };
    }
}
