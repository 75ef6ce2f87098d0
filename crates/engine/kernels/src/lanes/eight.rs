//! What vectors of eight `f32` share, in whatever registers an instruction set has for them, and sixteen in two of
//! them. The same steps give the same bits by AVX2 and NEON.

use super::{LANES, LaneMask, Lanes, Vector, sealed::Sealed};
use crate::exp::{EXP2_NEAREST, LOG2_ODD, ROUND};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Numbers in a vector of eight.
pub const WIDTH: usize = 8;

/// Eight `f32`, with the operations on their bits that functions are made of.
pub trait Eight: Vector<Scalar = f32> {
    /// Rounds to the nearest integer.
    fn round(self) -> Self;
    /// self * 2^n for the integer n in the low bits of `shifted`, where both are normal numbers.
    fn with_exponent_from(self, shifted: Self) -> Self;
    /// 2^self for integers from -126 to 127.
    fn power_of_two(self) -> Self;
    /// n and m with self = 2^n m and m in [0.75, 1.5), for positive normal numbers.
    fn exponent(self) -> (Self, Self);
    /// The sums of the lanes of eight vectors: numbers 4 lanes apart are added, then 2 and 1.
    fn sums(of: &[Self; WIDTH]) -> Self;
    /// Transposes a matrix of eight by eight.
    fn transposed(rows: [Self; WIDTH]) -> [Self; WIDTH];
}

/// The methods of [`Vector`] that consist of the same steps for every vector of eight.
macro_rules! functions {
    () => {
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
            eight::exp2_times(self, scale)
        }
        #[inline(always)]
        fn exp2(self) -> Self {
            eight::exp2(self)
        }
        #[inline(always)]
        fn exp(self) -> Self {
            eight::exp(self)
        }
        #[inline(always)]
        fn log2(self) -> Self {
            eight::log2(self)
        }
        #[inline(always)]
        fn add_sums(of: &[Self; LANES], row: &mut [f32; LANES]) {
            eight::add_sums(of, row);
        }
    };
}
pub(super) use functions;

/// [`Vector::exp2_times`].
#[inline(always)]
pub fn exp2_times<V: Eight>(x: V, scale: V) -> V {
    // Adding 1.5 * 2^23 rounds to the nearest integer n and leaves it in the low bits, from where it goes to the
    // exponent of 2^(x - n). That is at least 1 where n is -126.
    let x = x.max(V::splat(-126.0));
    let shift = V::splat(ROUND);
    let shifted = x + shift;
    EXP2_NEAREST.polynomial(x - (shifted - shift)).with_exponent_from(shifted) * scale
}

/// [`Vector::exp2`].
#[inline(always)]
pub fn exp2<V: Eight>(x: V) -> V {
    let within = x.max(V::splat(-151.0)).min(V::splat(129.0));
    let n = within.round();
    scaled(EXP2_NEAREST.polynomial(within - n), n).or(x.ge(x), x)
}

/// [`Vector::exp`].
#[inline(always)]
pub fn exp<V: Eight>(x: V) -> V {
    let (n, e) = crate::exp::reduced(x);
    scaled(e, n).or(x.ge(x), x)
}

/// [`Vector::log2`], by the steps of [`log2_f32`](crate::exp::log2_f32).
#[inline(always)]
pub fn log2<V: Eight>(x: V) -> V {
    let (n, m) = x.exponent();
    let one = V::splat(1.0);
    let t = (m - one) / (m + one);
    let square = t * t;
    let mut p = V::splat(LOG2_ODD[4]);
    for k in (0..4).rev() {
        p = p * square + V::splat(LOG2_ODD[k]);
    }
    p * t + n
}

/// [`Vector::add_sums`].
#[inline(always)]
pub fn add_sums<V: Eight>(of: &[V; LANES], row: &mut [f32; LANES]) {
    for (half, of) in of.as_chunks::<WIDTH>().0.iter().enumerate() {
        (V::load_part(row, half) + V::sums(of)).store_part(row, half);
    }
}

/// x * 2^n for integers n from -252 to 254, by two factors, since 2^n may be out of range.
#[inline(always)]
fn scaled<V: Eight>(x: V, n: V) -> V {
    let half = (n * V::splat(0.5)).round();
    x * half.power_of_two() * (n - half).power_of_two()
}

/// Two vectors of eight, or their masks.
#[derive(Clone, Copy)]
pub struct Pair<V>(V, V);

impl<V> Sealed for Pair<V> {}

macro_rules! operator {
    ($trait:ident $method:ident $($other:ident)?) => {
        impl<V: Eight> $trait for Pair<V> {
            type Output = Self;
            #[inline(always)]
            fn $method(self $(, $other: Self)?) -> Self {
                Self(self.0.$method($($other.0)?), self.1.$method($($other.1)?))
            }
        }
    };
}
operator!(Add add other);
operator!(Sub sub other);
operator!(Mul mul other);
operator!(Div div other);
operator!(Neg neg);

/// Defines methods that do the same with both halves.
macro_rules! halves {
    ($(fn $name:ident(self $(, $arg:ident: $type:ty)*) -> $out:ty;)*) => {$(
        #[inline(always)]
        fn $name(self $(, $arg: $type)*) -> $out {
            Pair(self.0.$name($($arg.0),*), self.1.$name($($arg.1),*))
        }
    )*};
}

impl<M: LaneMask> LaneMask for Pair<M> {
    #[inline(always)]
    fn from_bits(bits: u16) -> Self {
        Self(M::from_bits(bits & 255), M::from_bits(bits >> WIDTH))
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

impl<V: Eight> Vector for Pair<V> {
    type Scalar = f32;
    type Mask = Pair<V::Mask>;
    const WIDTH: usize = LANES;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(V::splat(x), V::splat(x))
    }
    #[inline(always)]
    fn load_part(row: &[f32; LANES], _part: usize) -> Self {
        Self(V::load_part(row, 0), V::load_part(row, 1))
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
        fn ge(self, other: Self) -> Self::Mask;
        fn gt(self, other: Self) -> Self::Mask;
        fn only(self, mask: Self::Mask) -> Self;
        fn or(self, mask: Self::Mask, other: Self) -> Self;
        fn negative(self, mask: Self::Mask) -> Self;
    }
    #[inline(always)]
    fn normal(self) -> (Self, Self) {
        let ((below, density), (below_1, density_1)) = (self.0.normal(), self.1.normal());
        (Self(below, below_1), Self(density, density_1))
    }
    #[inline(always)]
    fn add_sums(of: &[Self; LANES], row: &mut [f32; LANES]) {
        (Self::load(row) + <Self as Lanes>::sums(of)).store(row);
    }
}

impl<V: Eight> Lanes for Pair<V> {
    type Part = V;

    #[inline(always)]
    fn sums(of: &[Self; LANES]) -> Self {
        let mut added = [of[0].0; LANES];
        for (sum, row) in added.iter_mut().zip(of) {
            *sum = row.0 + row.1;
        }
        let halves = added.as_chunks().0;
        Self(V::sums(&halves[0]), V::sums(&halves[1]))
    }

    #[inline(always)]
    fn transpose(rows: &mut [Self; LANES]) {
        let mut blocks = [[rows[0].0; WIDTH]; 4];
        for i in 0..WIDTH {
            blocks[0][i] = rows[i].0;
            blocks[1][i] = rows[i].1;
            blocks[2][i] = rows[WIDTH + i].0;
            blocks[3][i] = rows[WIDTH + i].1;
        }
        let [a, b, c, d] = blocks;
        let (a, b, c, d) = (V::transposed(a), V::transposed(b), V::transposed(c), V::transposed(d));
        for i in 0..WIDTH {
            rows[i] = Self(a[i], c[i]);
            rows[WIDTH + i] = Self(b[i], d[i]);
        }
    }
}
