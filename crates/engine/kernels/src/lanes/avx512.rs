//! Vectors of sixteen `f32` in one AVX-512 register.
//!
//! These types are reached only through [`run`], which is compiled for AVX-512 and called only if the processor
//! supports it. That makes every `unsafe` block below sound.
#![allow(unsafe_code)]

use super::{LANES, LaneKernel, Lanes, Vector, sealed::Sealed};
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

#[derive(Clone, Copy)]
pub struct Zmm(__m512);

#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq,avx2,fma,bmi1,bmi2,popcnt,lzcnt")]
pub fn run<K: LaneKernel<f32>>(kernel: K) -> K::Output {
    kernel.run::<Zmm>()
}

impl Sealed for Zmm {}

macro_rules! operator {
    ($trait:ident $method:ident $intrinsic:ident) => {
        impl $trait for Zmm {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: AVX-512 is available, see the module.
                Self(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    };
}
operator!(Add add _mm512_add_ps);
operator!(Sub sub _mm512_sub_ps);
operator!(Mul mul _mm512_mul_ps);
operator!(Div div _mm512_div_ps);

impl Neg for Zmm {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: AVX-512 is available, see the module.
        Self(unsafe { _mm512_xor_ps(self.0, _mm512_set1_ps(-0.0)) })
    }
}

/// Defines methods whose bodies are single expressions of intrinsics.
macro_rules! methods {
    ($($(#[$doc:meta])* fn $name:ident($($arg:tt)*) -> $out:ty = $body:expr;)*) => {$(
        #[inline(always)]
        fn $name($($arg)*) -> $out {
            // SAFETY: AVX-512 is available, see the module; references point to sixteen numbers.
            unsafe { $body }
        }
    )*};
}

impl Vector for Zmm {
    type Scalar = f32;
    type Mask = __mmask16;
    const WIDTH: usize = LANES;

    methods! {
        fn splat(x: f32) -> Self = Self(_mm512_set1_ps(x));
        fn load_part(row: &[f32; LANES], _part: usize) -> Self = Self(_mm512_loadu_ps(row.as_ptr()));
        fn store_part(self, row: &mut [f32; LANES], _part: usize) -> () = _mm512_storeu_ps(row.as_mut_ptr(), self.0);
        fn mul_add(self, b: Self, c: Self) -> Self = Self(_mm512_fmadd_ps(self.0, b.0, c.0));
        fn neg_mul_add(self, b: Self, c: Self) -> Self = Self(_mm512_fnmadd_ps(self.0, b.0, c.0));
        fn min(self, other: Self) -> Self = Self(_mm512_min_ps(self.0, other.0));
        fn max(self, other: Self) -> Self = Self(_mm512_max_ps(self.0, other.0));
        fn abs(self) -> Self = Self(_mm512_abs_ps(self.0));
        fn sqrt(self) -> Self = Self(_mm512_sqrt_ps(self.0));
        fn ge(self, other: Self) -> __mmask16 = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(self.0, other.0);
        fn gt(self, other: Self) -> __mmask16 = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(self.0, other.0);
        fn ge_among(self, other: Self, mask: __mmask16) -> __mmask16 =
            _mm512_mask_cmp_ps_mask::<_CMP_GE_OQ>(mask, self.0, other.0);
        fn gt_among(self, other: Self, mask: __mmask16) -> __mmask16 =
            _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(mask, self.0, other.0);
        fn only(self, mask: __mmask16) -> Self = Self(_mm512_maskz_mov_ps(mask, self.0));
        fn negative(self, mask: __mmask16) -> Self =
            Self(_mm512_mask_or_ps(self.0, mask, self.0, _mm512_set1_ps(-0.0)));
        fn or(self, mask: __mmask16, other: Self) -> Self = Self(_mm512_mask_mov_ps(other.0, mask, self.0));
    }

    #[inline(always)]
    fn normal(self) -> (Self, Self) {
        crate::gelu::normal(self)
    }

    #[inline(always)]
    fn recip(self) -> Self {
        // An estimate of 14 bits, and one step of Newton's method.
        // SAFETY: AVX-512 is available, see the module.
        let rough = Self(unsafe { _mm512_rcp14_ps(self.0) });
        rough.mul_add(self.neg_mul_add(rough, Self::splat(1.0)), rough)
    }

    #[inline(always)]
    fn exp2_times(self, scale: Self) -> Self {
        // x = floor(x) + fraction; scale * 2^floor(x) does not depend on the polynomial.
        // SAFETY: AVX-512 is available, see the module.
        let (fraction, power) = unsafe {
            const FLOOR: i32 = _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC;
            (Self(_mm512_reduce_ps::<FLOOR>(self.0)), Self(_mm512_scalef_ps(scale.0, self.0)))
        };
        crate::exp::EXP2_FLOOR.polynomial(fraction) * power
    }

    #[inline(always)]
    fn exp2(self) -> Self {
        // The bits of `exp2_times(1)`, by one operation less.
        // SAFETY: AVX-512 is available, see the module.
        unsafe {
            const FLOOR: i32 = _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC;
            let fraction = Self(_mm512_reduce_ps::<FLOOR>(self.0));
            Self(_mm512_scalef_ps(crate::exp::EXP2_FLOOR.polynomial(fraction).0, self.0))
        }
    }

    #[inline(always)]
    fn exp(self) -> Self {
        let (n, e) = crate::exp::reduced(self);
        // SAFETY: AVX-512 is available, see the module.
        Self(unsafe { _mm512_scalef_ps(e.0, n.0) }).or(self.ge(self), self)
    }

    #[inline(always)]
    fn log2(self) -> Self {
        // SAFETY: AVX-512 is available, see the module.
        let (exponent, mantissa) = unsafe {
            // Mantissa in [0.75, 1.5), and the exponent that goes with it.
            let mantissa = _mm512_getmant_ps::<_MM_MANT_NORM_P75_1P5, _MM_MANT_SIGN_SRC>(self.0);
            (Self(_mm512_getexp_ps(_mm512_div_ps(self.0, mantissa))), Self(mantissa))
        };
        let one = Self::splat(1.0);
        let t = (mantissa - one) / (mantissa + one);
        let square = t * t;
        let [c0, c1, c2, c3, c4] = crate::exp::LOG2_ODD;
        let (c0, c1, c2, c3, c4) =
            (Self::splat(c0), Self::splat(c1), Self::splat(c2), Self::splat(c3), Self::splat(c4));
        let p = c4.mul_add(square, c3);
        let p = p.mul_add(square, c2);
        let p = p.mul_add(square, c1);
        let p = p.mul_add(square, c0);
        p.mul_add(t, exponent)
    }

    #[inline(always)]
    fn add_sums(of: &[Self; LANES], row: &mut [f32; LANES]) {
        (Self::load(row) + Self::sums(of)).store(row);
    }
}

impl Lanes for Zmm {
    type Part = Self;

    #[inline(always)]
    fn sums(of: &[Self; LANES]) -> Self {
        /// Adds the halves, quarters, pairs or neighbors of two vectors and combines the results into one vector.
        macro_rules! fold {
            ($rows:expr, $apart:literal, |$a:ident, $b:ident| $low:expr, $high:expr) => {{
                let mut out = [$rows[0]; $apart];
                for (i, out) in out.iter_mut().enumerate() {
                    let ($a, $b) = ($rows[i].0, $rows[i + $apart].0);
                    // SAFETY: AVX-512 is available, see the module.
                    *out = Self(unsafe { _mm512_add_ps($low, $high) });
                }
                out
            }};
        }
        // After each fold a vector holds sums of twice as many rows, half as many of each.
        let rows = fold!(of, 8, |a, b| _mm512_shuffle_f32x4::<0x44>(a, b), _mm512_shuffle_f32x4::<0xee>(a, b));
        let rows = fold!(rows, 4, |a, b| _mm512_shuffle_f32x4::<0x88>(a, b), _mm512_shuffle_f32x4::<0xdd>(a, b));
        let rows = fold!(rows, 2, |a, b| _mm512_shuffle_ps::<0x44>(a, b), _mm512_shuffle_ps::<0xee>(a, b));
        let [sum] = fold!(rows, 1, |a, b| _mm512_shuffle_ps::<0x88>(a, b), _mm512_shuffle_ps::<0xdd>(a, b));
        // The folds left the rows in this order, which is its own inverse.
        // SAFETY: AVX-512 is available, see the module.
        Self(unsafe {
            let order = _mm512_setr_epi32(0, 2, 1, 3, 8, 10, 9, 11, 4, 6, 5, 7, 12, 14, 13, 15);
            _mm512_permutexvar_ps(order, sum.0)
        })
    }

    #[inline(always)]
    fn transpose(rows: &mut [Self; LANES]) {
        // SAFETY: AVX-512 is available, see the module.
        unsafe {
            // 4x4 blocks are transposed inside the 128-bit groups, then the groups.
            let mut t = [_mm512_setzero_ps(); LANES];
            for i in 0..4 {
                let [a, b, c, d] = [rows[4 * i].0, rows[4 * i + 1].0, rows[4 * i + 2].0, rows[4 * i + 3].0];
                let (ab_low, ab_high) = (_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b));
                let (cd_low, cd_high) = (_mm512_unpacklo_ps(c, d), _mm512_unpackhi_ps(c, d));
                t[4 * i] = _mm512_shuffle_ps::<0x44>(ab_low, cd_low);
                t[4 * i + 1] = _mm512_shuffle_ps::<0xee>(ab_low, cd_low);
                t[4 * i + 2] = _mm512_shuffle_ps::<0x44>(ab_high, cd_high);
                t[4 * i + 3] = _mm512_shuffle_ps::<0xee>(ab_high, cd_high);
            }
            for i in 0..4 {
                let [a, b, c, d] = [t[i], t[4 + i], t[8 + i], t[12 + i]];
                let (ab_even, ab_odd) = (_mm512_shuffle_f32x4::<0x88>(a, b), _mm512_shuffle_f32x4::<0xdd>(a, b));
                let (cd_even, cd_odd) = (_mm512_shuffle_f32x4::<0x88>(c, d), _mm512_shuffle_f32x4::<0xdd>(c, d));
                rows[i] = Self(_mm512_shuffle_f32x4::<0x88>(ab_even, cd_even));
                rows[4 + i] = Self(_mm512_shuffle_f32x4::<0x88>(ab_odd, cd_odd));
                rows[8 + i] = Self(_mm512_shuffle_f32x4::<0xdd>(ab_even, cd_even));
                rows[12 + i] = Self(_mm512_shuffle_f32x4::<0xdd>(ab_odd, cd_odd));
            }
        }
    }
}
