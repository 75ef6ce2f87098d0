//! Vectors of eight `f32` in an AVX2 register.
//!
//! These types are reached only through [`run`], which is compiled for AVX2 with FMA and called only if the processor
//! supports both. That makes every `unsafe` block below sound.
#![allow(unsafe_code)]

use super::eight::{self, Eight, Pair, WIDTH};
use super::{LANES, LaneKernel, LaneMask, Row, Vector, sealed::Sealed};
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

#[derive(Clone, Copy)]
pub struct Ymm(__m256);

/// All bits of a lane, or none.
#[derive(Clone, Copy)]
pub struct Mask(__m256);

#[target_feature(enable = "avx2,fma,bmi1,bmi2,popcnt,lzcnt")]
pub fn run<K: LaneKernel<f32>>(kernel: K) -> K::Output {
    kernel.run::<Pair<Ymm>>()
}

impl Sealed for Ymm {}

macro_rules! operator {
    ($trait:ident $method:ident $intrinsic:ident) => {
        impl $trait for Ymm {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: AVX2 is available, see the module.
                unsafe { Self($intrinsic(self.0, other.0)) }
            }
        }
    };
}
operator!(Add add _mm256_add_ps);
operator!(Sub sub _mm256_sub_ps);
operator!(Mul mul _mm256_mul_ps);
operator!(Div div _mm256_div_ps);

impl Neg for Ymm {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: AVX2 is available, see the module.
        unsafe { Self(_mm256_xor_ps(self.0, _mm256_set1_ps(-0.0))) }
    }
}

/// Defines methods whose bodies are single expressions of intrinsics.
macro_rules! methods {
    ($(fn $name:ident($($arg:tt)*) -> $out:ty = $body:expr;)*) => {$(
        #[inline(always)]
        fn $name($($arg)*) -> $out {
            // SAFETY: AVX2 is available, see the module; references point to eight numbers.
            unsafe { $body }
        }
    )*};
}

impl LaneMask for Mask {
    methods! {
        fn from_bits(bits: u16) -> Self = {
            let lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let chosen = _mm256_and_si256(_mm256_set1_epi32(i32::from(bits)), lane);
            Self(_mm256_castsi256_ps(_mm256_cmpeq_epi32(chosen, lane)))
        };
        fn bits(self) -> u16 = _mm256_movemask_ps(self.0) as u16;
        fn and(self, other: Self) -> Self = Self(_mm256_and_ps(self.0, other.0));
        fn and_not(self, other: Self) -> Self = Self(_mm256_andnot_ps(other.0, self.0));
        fn or(self, other: Self) -> Self = Self(_mm256_or_ps(self.0, other.0));
    }
}

impl Vector for Ymm {
    type Scalar = f32;
    type Mask = Mask;
    const WIDTH: usize = WIDTH;

    methods! {
        fn splat(x: f32) -> Self = Self(_mm256_set1_ps(x));
        fn load_part(row: &[f32; LANES], part: usize) -> Self =
            Self(_mm256_loadu_ps(row.as_chunks::<WIDTH>().0[part].as_ptr()));
        fn store_part(self, row: &mut [f32; LANES], part: usize) -> () =
            _mm256_storeu_ps(row.as_chunks_mut::<WIDTH>().0[part].as_mut_ptr(), self.0);
        fn mul_add(self, b: Self, c: Self) -> Self = Self(_mm256_fmadd_ps(self.0, b.0, c.0));
        fn neg_mul_add(self, b: Self, c: Self) -> Self = Self(_mm256_fnmadd_ps(self.0, b.0, c.0));
        fn min(self, other: Self) -> Self = Self(_mm256_min_ps(self.0, other.0));
        fn max(self, other: Self) -> Self = Self(_mm256_max_ps(self.0, other.0));
        fn abs(self) -> Self = Self(_mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0));
        fn sqrt(self) -> Self = Self(_mm256_sqrt_ps(self.0));
        fn ge(self, other: Self) -> Mask = Mask(_mm256_cmp_ps::<_CMP_GE_OQ>(self.0, other.0));
        fn gt(self, other: Self) -> Mask = Mask(_mm256_cmp_ps::<_CMP_GT_OQ>(self.0, other.0));
        fn only(self, mask: Mask) -> Self = Self(_mm256_and_ps(self.0, mask.0));
        fn negative(self, mask: Mask) -> Self =
            Self(_mm256_or_ps(self.0, _mm256_and_ps(mask.0, _mm256_set1_ps(-0.0))));
        fn or(self, mask: Mask, other: Self) -> Self = Self(_mm256_blendv_ps(other.0, self.0, mask.0));
    }

    // By one sum for the address: as two indices, row and half, it takes the compiler several.
    #[inline(always)]
    fn load_nth(rows: &[Row<f32>; LANES], index: usize) -> Self {
        assert!(index < 2 * LANES, "vector {index} of sixteen rows");
        // SAFETY: AVX2 is available, see the module; the rows are arrays without gaps, and the index is in them.
        unsafe { Self(_mm256_loadu_ps(rows.as_ptr().cast::<f32>().add(index * WIDTH))) }
    }
    #[inline(always)]
    fn store_nth(self, rows: &mut [Row<f32>; LANES], index: usize) {
        assert!(index < 2 * LANES, "vector {index} of sixteen rows");
        // SAFETY: as above.
        unsafe { _mm256_storeu_ps(rows.as_mut_ptr().cast::<f32>().add(index * WIDTH), self.0) }
    }

    eight::functions!();
}

impl Eight for Ymm {
    methods! {
        fn round(self) -> Self = Self(_mm256_round_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(self.0));
        fn with_exponent_from(self, shifted: Self) -> Self = {
            let exponent = _mm256_slli_epi32::<23>(_mm256_castps_si256(shifted.0));
            Self(_mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(self.0), exponent)))
        };
        fn power_of_two(self) -> Self = {
            let biased = _mm256_add_epi32(_mm256_cvtps_epi32(self.0), _mm256_set1_epi32(127));
            Self(_mm256_castsi256_ps(_mm256_slli_epi32::<23>(biased)))
        };
        fn exponent(self) -> (Self, Self) = {
            let bits = _mm256_castps_si256(self.0);
            let n = _mm256_srai_epi32::<23>(_mm256_sub_epi32(bits, _mm256_castps_si256(_mm256_set1_ps(0.75))));
            let m = _mm256_sub_epi32(bits, _mm256_slli_epi32::<23>(n));
            (Self(_mm256_cvtepi32_ps(n)), Self(_mm256_castsi256_ps(m)))
        };
    }

    #[inline(always)]
    fn sums(of: &[Self; WIDTH]) -> Self {
        let [Self(a), Self(b), Self(c), Self(d), Self(e), Self(f), Self(g), Self(h)] = *of;
        // SAFETY: AVX2 is available, see the module.
        unsafe {
            // Adds halves, then pairs, then neighbors; each time two vectors are combined into one.
            macro_rules! halves {
                ($a:expr, $b:expr) => {
                    _mm256_add_ps(_mm256_permute2f128_ps::<0x20>($a, $b), _mm256_permute2f128_ps::<0x31>($a, $b))
                };
            }
            macro_rules! pairs {
                ($a:expr, $b:expr) => {
                    _mm256_add_ps(_mm256_shuffle_ps::<0x44>($a, $b), _mm256_shuffle_ps::<0xee>($a, $b))
                };
            }
            let (ae, bf, cg, dh) = (halves!(a, e), halves!(b, f), halves!(c, g), halves!(d, h));
            let (even, odd) = (pairs!(ae, cg), pairs!(bf, dh));
            let sums = _mm256_add_ps(_mm256_shuffle_ps::<0x88>(even, odd), _mm256_shuffle_ps::<0xdd>(even, odd));
            // In each half: rows 0, 2, 1, 3.
            Self(_mm256_permute_ps::<0b11_01_10_00>(sums))
        }
    }

    #[inline(always)]
    fn transposed([a, b, c, d, e, f, g, h]: [Self; WIDTH]) -> [Self; WIDTH] {
        // SAFETY: AVX2 is available, see the module.
        unsafe {
            let (ab, cd) = (_mm256_unpacklo_ps(a.0, b.0), _mm256_unpacklo_ps(c.0, d.0));
            let (ab_high, cd_high) = (_mm256_unpackhi_ps(a.0, b.0), _mm256_unpackhi_ps(c.0, d.0));
            let (ef, gh) = (_mm256_unpacklo_ps(e.0, f.0), _mm256_unpacklo_ps(g.0, h.0));
            let (ef_high, gh_high) = (_mm256_unpackhi_ps(e.0, f.0), _mm256_unpackhi_ps(g.0, h.0));
            let first = [
                _mm256_shuffle_ps::<0x44>(ab, cd),
                _mm256_shuffle_ps::<0xee>(ab, cd),
                _mm256_shuffle_ps::<0x44>(ab_high, cd_high),
                _mm256_shuffle_ps::<0xee>(ab_high, cd_high),
            ];
            let second = [
                _mm256_shuffle_ps::<0x44>(ef, gh),
                _mm256_shuffle_ps::<0xee>(ef, gh),
                _mm256_shuffle_ps::<0x44>(ef_high, gh_high),
                _mm256_shuffle_ps::<0xee>(ef_high, gh_high),
            ];
            let mut out = [a; WIDTH];
            for i in 0..4 {
                out[i] = Self(_mm256_permute2f128_ps::<0x20>(first[i], second[i]));
                out[4 + i] = Self(_mm256_permute2f128_ps::<0x31>(first[i], second[i]));
            }
            out
        }
    }
}
