//! Vectors of sixteen `f32` in two AVX2 registers.
//!
//! These types are reached only through [`run`], which is compiled for AVX2 with FMA and called only if the processor
//! supports both. That makes every `unsafe` block below sound.
#![allow(unsafe_code)]

use super::{LANES, LaneKernel, LaneMask, Lanes, sealed::Sealed};
use crate::Real;
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

#[derive(Clone, Copy)]
pub struct Ymm2(__m256, __m256);

/// All bits of a lane, or none.
#[derive(Clone, Copy)]
pub struct Mask2(__m256, __m256);

#[target_feature(enable = "avx2,fma")]
pub fn run<K: LaneKernel<f32>>(kernel: K) -> K::Output {
    kernel.run::<Ymm2>()
}

impl Sealed for Ymm2 {}

macro_rules! operator {
    ($trait:ident $method:ident $intrinsic:ident) => {
        impl $trait for Ymm2 {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: AVX2 is available, see the module.
                unsafe { Self($intrinsic(self.0, other.0), $intrinsic(self.1, other.1)) }
            }
        }
    };
}
operator!(Add add _mm256_add_ps);
operator!(Sub sub _mm256_sub_ps);
operator!(Mul mul _mm256_mul_ps);
operator!(Div div _mm256_div_ps);

impl Neg for Ymm2 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: AVX2 is available, see the module.
        unsafe {
            let sign = _mm256_set1_ps(-0.0);
            Self(_mm256_xor_ps(self.0, sign), _mm256_xor_ps(self.1, sign))
        }
    }
}

/// Defines methods whose bodies are single expressions of intrinsics.
macro_rules! methods {
    ($(fn $name:ident($($arg:tt)*) -> $out:ty = $body:expr;)*) => {$(
        #[inline(always)]
        fn $name($($arg)*) -> $out {
            // SAFETY: AVX2 is available, see the module; references point to sixteen numbers.
            unsafe { $body }
        }
    )*};
}

impl LaneMask for Mask2 {
    #[inline(always)]
    fn from_bits(bits: u16) -> Self {
        // SAFETY: AVX2 is available, see the module.
        unsafe {
            let lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let half = |bits: i32| {
                let chosen = _mm256_and_si256(_mm256_set1_epi32(bits), lane);
                _mm256_castsi256_ps(_mm256_cmpeq_epi32(chosen, lane))
            };
            Self(half(i32::from(bits & 255)), half(i32::from(bits >> 8)))
        }
    }
    methods! {
        fn bits(self) -> u16 = (_mm256_movemask_ps(self.0) | _mm256_movemask_ps(self.1) << 8) as u16;
        fn and(self, other: Self) -> Self = Self(_mm256_and_ps(self.0, other.0), _mm256_and_ps(self.1, other.1));
        fn and_not(self, other: Self) -> Self =
            Self(_mm256_andnot_ps(other.0, self.0), _mm256_andnot_ps(other.1, self.1));
        fn or(self, other: Self) -> Self = Self(_mm256_or_ps(self.0, other.0), _mm256_or_ps(self.1, other.1));
    }
}

impl Lanes for Ymm2 {
    type Scalar = f32;
    type Mask = Mask2;
    const REGISTERS: usize = 2;

    methods! {
        fn splat(x: f32) -> Self = Self(_mm256_set1_ps(x), _mm256_set1_ps(x));
        fn load(x: &[f32; LANES]) -> Self = Self(_mm256_loadu_ps(x.as_ptr()), _mm256_loadu_ps(x[8..].as_ptr()));
        fn store(self, to: &mut [f32; LANES]) -> () = {
            _mm256_storeu_ps(to.as_mut_ptr(), self.0);
            _mm256_storeu_ps(to[8..].as_mut_ptr(), self.1)
        };
        fn mul_add(self, b: Self, c: Self) -> Self =
            Self(_mm256_fmadd_ps(self.0, b.0, c.0), _mm256_fmadd_ps(self.1, b.1, c.1));
        fn neg_mul_add(self, b: Self, c: Self) -> Self =
            Self(_mm256_fnmadd_ps(self.0, b.0, c.0), _mm256_fnmadd_ps(self.1, b.1, c.1));
        fn min(self, other: Self) -> Self = Self(_mm256_min_ps(self.0, other.0), _mm256_min_ps(self.1, other.1));
        fn max(self, other: Self) -> Self = Self(_mm256_max_ps(self.0, other.0), _mm256_max_ps(self.1, other.1));
        fn abs(self) -> Self = {
            let sign = _mm256_set1_ps(-0.0);
            Self(_mm256_andnot_ps(sign, self.0), _mm256_andnot_ps(sign, self.1))
        };
        fn sqrt(self) -> Self = Self(_mm256_sqrt_ps(self.0), _mm256_sqrt_ps(self.1));
        fn ge(self, other: Self) -> Mask2 =
            Mask2(_mm256_cmp_ps::<_CMP_GE_OQ>(self.0, other.0), _mm256_cmp_ps::<_CMP_GE_OQ>(self.1, other.1));
        fn gt(self, other: Self) -> Mask2 =
            Mask2(_mm256_cmp_ps::<_CMP_GT_OQ>(self.0, other.0), _mm256_cmp_ps::<_CMP_GT_OQ>(self.1, other.1));
        fn only(self, mask: Mask2) -> Self = Self(_mm256_and_ps(self.0, mask.0), _mm256_and_ps(self.1, mask.1));
        fn negative(self, mask: Mask2) -> Self = {
            let sign = _mm256_set1_ps(-0.0);
            let (a, b) = (_mm256_and_ps(mask.0, sign), _mm256_and_ps(mask.1, sign));
            Self(_mm256_or_ps(self.0, a), _mm256_or_ps(self.1, b))
        };
        fn or(self, mask: Mask2, other: Self) -> Self = Self(
            _mm256_blendv_ps(other.0, self.0, mask.0),
            _mm256_blendv_ps(other.1, self.1, mask.1),
        );
    }

    #[inline(always)]
    fn normal(self) -> (Self, Self) {
        crate::gelu::normal(self)
    }

    #[inline(always)]
    fn recip(self) -> Self {
        Self::splat(1.0) / self
    }

    #[inline(always)]
    fn exp2_times(self, scale: Self) -> Self {
        let x = self.max(Self::splat(-126.0));
        let n = x.round();
        crate::exp::EXP2_NEAREST.polynomial(x - n) * (n.power_of_two() * scale)
    }

    #[inline(always)]
    fn exp2(self) -> Self {
        let x = self.max(Self::splat(-151.0)).min(Self::splat(129.0));
        let n = x.round();
        crate::exp::EXP2_NEAREST.polynomial(x - n).scaled(n).or(self.ge(self), self)
    }

    #[inline(always)]
    fn exp(self) -> Self {
        let (n, e) = crate::exp::reduced(self);
        e.scaled(n).or(self.ge(self), self)
    }

    #[inline(always)]
    fn log2(self) -> Self {
        let x = self.to_array();
        Self::from_fn(
            #[inline(always)]
            |i| Real::log2(x[i]),
        )
    }

    #[inline(always)]
    fn sums(of: &[Self; LANES]) -> Self {
        let mut halves = [of[0].0; LANES];
        for (half, row) in halves.iter_mut().zip(of) {
            // SAFETY: AVX2 is available, see the module.
            *half = unsafe { _mm256_add_ps(row.0, row.1) };
        }
        let [a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p] = halves;
        Self(sums_of_eight([a, b, c, d, e, f, g, h]), sums_of_eight([i, j, k, l, m, n, o, p]))
    }

    #[inline(always)]
    fn transpose(rows: &mut [Self; LANES]) {
        let mut blocks = [[rows[0].0; 8]; 4];
        for i in 0..8 {
            blocks[0][i] = rows[i].0;
            blocks[1][i] = rows[i].1;
            blocks[2][i] = rows[8 + i].0;
            blocks[3][i] = rows[8 + i].1;
        }
        let [a, b, c, d] = blocks;
        let (a, b, c, d) = (transposed(a), transposed(b), transposed(c), transposed(d));
        for i in 0..8 {
            rows[i] = Self(a[i], c[i]);
            rows[8 + i] = Self(b[i], d[i]);
        }
    }
}

impl Ymm2 {
    /// Rounds to the nearest integer.
    #[inline(always)]
    fn round(self) -> Self {
        const NEAREST: i32 = _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC;
        // SAFETY: AVX2 is available, see the module.
        unsafe { Self(_mm256_round_ps::<NEAREST>(self.0), _mm256_round_ps::<NEAREST>(self.1)) }
    }

    /// 2^self for integers from -126 to 127.
    #[inline(always)]
    fn power_of_two(self) -> Self {
        Self(power_of_two(self.0), power_of_two(self.1))
    }

    /// self * 2^n for integers n from -252 to 254, by two factors, since 2^n may be out of range.
    #[inline(always)]
    fn scaled(self, n: Self) -> Self {
        let half = (n * Self::splat(0.5)).round();
        self * half.power_of_two() * (n - half).power_of_two()
    }
}

#[inline(always)]
fn power_of_two(n: __m256) -> __m256 {
    // SAFETY: AVX2 is available, see the module.
    unsafe {
        let biased = _mm256_add_epi32(_mm256_cvtps_epi32(n), _mm256_set1_epi32(127));
        _mm256_castsi256_ps(_mm256_slli_epi32::<23>(biased))
    }
}

/// The sums of the lanes of eight vectors.
#[inline(always)]
fn sums_of_eight([a, b, c, d, e, f, g, h]: [__m256; 8]) -> __m256 {
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
        _mm256_permute_ps::<0b11_01_10_00>(sums)
    }
}

/// Transposes a matrix of eight by eight.
#[inline(always)]
fn transposed([a, b, c, d, e, f, g, h]: [__m256; 8]) -> [__m256; 8] {
    // SAFETY: AVX2 is available, see the module.
    unsafe {
        let (ab, cd) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
        let (ab_high, cd_high) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
        let (ef, gh) = (_mm256_unpacklo_ps(e, f), _mm256_unpacklo_ps(g, h));
        let (ef_high, gh_high) = (_mm256_unpackhi_ps(e, f), _mm256_unpackhi_ps(g, h));
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
        let mut out = [a; 8];
        for i in 0..4 {
            out[i] = _mm256_permute2f128_ps::<0x20>(first[i], second[i]);
            out[4 + i] = _mm256_permute2f128_ps::<0x31>(first[i], second[i]);
        }
        out
    }
}
