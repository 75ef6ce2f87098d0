//! Vectors of eight `f32` in an AVX2 register, and of sixteen in two.
//!
//! These types are reached only through [`run`], which is compiled for AVX2 with FMA and called only if the processor
//! supports both. That makes every `unsafe` block below sound.
#![allow(unsafe_code)]

use super::{LANES, LaneKernel, LaneMask, Lanes, Row, Vector, sealed::Sealed};
use crate::exp::{EXP2_NEAREST, LOG2_ODD};
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Numbers in a register.
const WIDTH: usize = 8;

#[derive(Clone, Copy)]
pub struct Ymm(__m256);

/// All bits of a lane, or none.
#[derive(Clone, Copy)]
pub struct Mask(__m256);

#[derive(Clone, Copy)]
pub struct Ymm2(Ymm, Ymm);

#[derive(Clone, Copy)]
pub struct Mask2(Mask, Mask);

#[target_feature(enable = "avx2,fma,bmi1,bmi2,popcnt,lzcnt")]
pub fn run<K: LaneKernel<f32>>(kernel: K) -> K::Output {
    kernel.run::<Ymm2>()
}

impl Sealed for Ymm {}
impl Sealed for Ymm2 {}

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
        impl $trait for Ymm2 {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0.$method(other.0), self.1.$method(other.1))
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

impl Neg for Ymm2 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0, -self.1)
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

/// Defines methods that do the same with both halves.
macro_rules! halves {
    ($(fn $name:ident(self $(, $arg:ident: $type:ty)*) -> $out:ident;)*) => {$(
        #[inline(always)]
        fn $name(self $(, $arg: $type)*) -> $out {
            $out(self.0.$name($($arg.0),*), self.1.$name($($arg.1),*))
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

impl LaneMask for Mask2 {
    #[inline(always)]
    fn from_bits(bits: u16) -> Self {
        Self(Mask::from_bits(bits & 255), Mask::from_bits(bits >> WIDTH))
    }
    #[inline(always)]
    fn bits(self) -> u16 {
        self.0.bits() | self.1.bits() << WIDTH
    }
    halves! {
        fn and(self, other: Self) -> Self;
        fn and_not(self, other: Self) -> Self;
        fn or(self, other: Self) -> Self;
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
        // Adding 1.5 * 2^23 rounds to the nearest integer n and leaves it in the low bits, from where it goes to the
        // exponent of 2^(x - n). That is at least 1 where n is -126.
        let x = self.max(Self::splat(-126.0));
        let shift = Self::splat(crate::exp::ROUND);
        let shifted = x + shift;
        EXP2_NEAREST.polynomial(x - (shifted - shift)).with_exponent_from(shifted) * scale
    }

    #[inline(always)]
    fn exp2(self) -> Self {
        let x = self.max(Self::splat(-151.0)).min(Self::splat(129.0));
        let n = x.round();
        EXP2_NEAREST.polynomial(x - n).scaled(n).or(self.ge(self), self)
    }

    #[inline(always)]
    fn exp(self) -> Self {
        let (n, e) = crate::exp::reduced(self);
        e.scaled(n).or(self.ge(self), self)
    }

    #[inline(always)]
    fn log2(self) -> Self {
        // The steps of `exp::log2_f32`: x = 2^n m with m in [0.75, 1.5).
        // SAFETY: AVX2 is available, see the module.
        let (n, m) = unsafe {
            let bits = _mm256_castps_si256(self.0);
            let n = _mm256_srai_epi32::<23>(_mm256_sub_epi32(bits, _mm256_castps_si256(_mm256_set1_ps(0.75))));
            let m = _mm256_sub_epi32(bits, _mm256_slli_epi32::<23>(n));
            (Self(_mm256_cvtepi32_ps(n)), Self(_mm256_castsi256_ps(m)))
        };
        let one = Self::splat(1.0);
        let t = (m - one) / (m + one);
        let square = t * t;
        let mut p = Self::splat(LOG2_ODD[4]);
        for k in (0..4).rev() {
            p = p * square + Self::splat(LOG2_ODD[k]);
        }
        p * t + n
    }

    #[inline(always)]
    fn add_sums(of: &[Self; LANES], row: &mut [f32; LANES]) {
        for (half, of) in of.as_chunks::<WIDTH>().0.iter().enumerate() {
            (Self::load_part(row, half) + sums_of_eight(of)).store_part(row, half);
        }
    }
}

impl Ymm {
    /// Rounds to the nearest integer.
    #[inline(always)]
    fn round(self) -> Self {
        // SAFETY: AVX2 is available, see the module.
        unsafe { Self(_mm256_round_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(self.0)) }
    }

    /// self * 2^n for the integer n in the low bits of `shifted`, where both are normal numbers.
    #[inline(always)]
    fn with_exponent_from(self, shifted: Self) -> Self {
        // SAFETY: AVX2 is available, see the module.
        unsafe {
            let exponent = _mm256_slli_epi32::<23>(_mm256_castps_si256(shifted.0));
            Self(_mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(self.0), exponent)))
        }
    }

    /// 2^self for integers from -126 to 127.
    #[inline(always)]
    fn power_of_two(self) -> Self {
        // SAFETY: AVX2 is available, see the module.
        unsafe {
            let biased = _mm256_add_epi32(_mm256_cvtps_epi32(self.0), _mm256_set1_epi32(127));
            Self(_mm256_castsi256_ps(_mm256_slli_epi32::<23>(biased)))
        }
    }

    /// self * 2^n for integers n from -252 to 254, by two factors, since 2^n may be out of range.
    #[inline(always)]
    fn scaled(self, n: Self) -> Self {
        let half = (n * Self::splat(0.5)).round();
        self * half.power_of_two() * (n - half).power_of_two()
    }
}

impl Vector for Ymm2 {
    type Scalar = f32;
    type Mask = Mask2;
    const WIDTH: usize = LANES;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(Ymm::splat(x), Ymm::splat(x))
    }
    #[inline(always)]
    fn load_part(row: &[f32; LANES], _part: usize) -> Self {
        Self(Ymm::load_part(row, 0), Ymm::load_part(row, 1))
    }
    #[inline(always)]
    fn store_part(self, row: &mut [f32; LANES], _part: usize) {
        self.0.store_part(row, 0);
        self.1.store_part(row, 1);
    }
    halves! {
        fn mul_add(self, b: Self, c: Self) -> Self;
        fn neg_mul_add(self, b: Self, c: Self) -> Self;
        fn min(self, other: Self) -> Self;
        fn max(self, other: Self) -> Self;
        fn abs(self) -> Self;
        fn sqrt(self) -> Self;
        fn recip(self) -> Self;
        fn exp2_times(self, scale: Self) -> Self;
        fn exp2(self) -> Self;
        fn exp(self) -> Self;
        fn log2(self) -> Self;
        fn ge(self, other: Self) -> Mask2;
        fn gt(self, other: Self) -> Mask2;
        fn only(self, mask: Mask2) -> Self;
        fn or(self, mask: Mask2, other: Self) -> Self;
        fn negative(self, mask: Mask2) -> Self;
    }
    #[inline(always)]
    fn normal(self) -> (Self, Self) {
        let ((below, density), (below_1, density_1)) = (self.0.normal(), self.1.normal());
        (Self(below, below_1), Self(density, density_1))
    }
    #[inline(always)]
    fn add_sums(of: &[Self; LANES], row: &mut [f32; LANES]) {
        (Self::load(row) + Self::sums(of)).store(row);
    }
}

impl Lanes for Ymm2 {
    type Part = Ymm;

    #[inline(always)]
    fn sums(of: &[Self; LANES]) -> Self {
        let mut added = [of[0].0; LANES];
        for (sum, row) in added.iter_mut().zip(of) {
            *sum = row.0 + row.1;
        }
        let halves = added.as_chunks().0;
        Self(sums_of_eight(&halves[0]), sums_of_eight(&halves[1]))
    }

    #[inline(always)]
    fn transpose(rows: &mut [Self; LANES]) {
        let mut blocks = [[rows[0].0.0; 8]; 4];
        for i in 0..8 {
            blocks[0][i] = rows[i].0.0;
            blocks[1][i] = rows[i].1.0;
            blocks[2][i] = rows[8 + i].0.0;
            blocks[3][i] = rows[8 + i].1.0;
        }
        let [a, b, c, d] = blocks;
        let (a, b, c, d) = (transposed(a), transposed(b), transposed(c), transposed(d));
        for i in 0..8 {
            rows[i] = Self(Ymm(a[i]), Ymm(c[i]));
            rows[8 + i] = Self(Ymm(b[i]), Ymm(d[i]));
        }
    }
}

/// The sums of the lanes of eight vectors.
#[inline(always)]
fn sums_of_eight(of: &[Ymm; 8]) -> Ymm {
    let [Ymm(a), Ymm(b), Ymm(c), Ymm(d), Ymm(e), Ymm(f), Ymm(g), Ymm(h)] = *of;
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
        Ymm(_mm256_permute_ps::<0b11_01_10_00>(sums))
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
