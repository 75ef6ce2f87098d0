//! Vectors as arrays of sixteen numbers, which the compiler vectorizes as far as it can.

use super::{LANES, LaneMask, Lanes, Vector, sealed::Sealed};
use crate::Real;
use std::array::from_fn;
use std::ops::{Add, Div, Mul, Neg, Sub};

#[derive(Clone, Copy)]
pub struct Array<T>([T; LANES]);

impl<T> Sealed for Array<T> {}

macro_rules! operator {
    ($trait:ident $method:ident $op:tt) => {
        impl<T: Real> $trait for Array<T> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(from_fn(|i| self.0[i] $op other.0[i]))
            }
        }
    };
}
operator!(Add add +);
operator!(Sub sub -);
operator!(Mul mul *);
operator!(Div div /);

impl<T: Real> Neg for Array<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|x| -x))
    }
}

impl LaneMask for [bool; LANES] {
    #[inline(always)]
    fn from_bits(bits: u16) -> Self {
        from_fn(|i| bits >> i & 1 == 1)
    }
    #[inline(always)]
    fn bits(self) -> u16 {
        (0..LANES).fold(0, |bits, i| bits | u16::from(self[i]) << i)
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        from_fn(|i| self[i] & other[i])
    }
    #[inline(always)]
    fn and_not(self, other: Self) -> Self {
        from_fn(|i| self[i] & !other[i])
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        from_fn(|i| self[i] | other[i])
    }
}

/// Horizontal sums: lane i of the result is the sum of row i. Adds numbers 8 lanes apart, then 4, 2 and 1, the order of
/// the other instruction sets.
pub fn sums<T: Real>(rows: &[[T; LANES]; LANES]) -> [T; LANES] {
    from_fn(|row| {
        let mut x = rows[row];
        let mut half = LANES / 2;
        while half > 0 {
            for i in 0..half {
                let upper = x[i + half];
                x[i] += upper;
            }
            half /= 2;
        }
        x[0]
    })
}

impl<T: Real> Vector for Array<T> {
    type Scalar = T;
    type Mask = [bool; LANES];
    const WIDTH: usize = LANES;

    #[inline(always)]
    fn splat(x: T) -> Self {
        Self([x; LANES])
    }
    #[inline(always)]
    fn load_part(row: &[T; LANES], _part: usize) -> Self {
        Self(*row)
    }
    #[inline(always)]
    fn store_part(self, row: &mut [T; LANES], _part: usize) {
        *row = self.0;
    }
    // A fused operation would be a library call here.
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self * b + c
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        c - self * b
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(from_fn(|i| if self.0[i] < other.0[i] { self.0[i] } else { other.0[i] }))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(from_fn(|i| if self.0[i] > other.0[i] { self.0[i] } else { other.0[i] }))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.map(T::abs))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(T::sqrt))
    }
    #[inline(always)]
    fn recip(self) -> Self {
        Self(self.0.map(|x| T::ONE / x))
    }
    #[inline(always)]
    fn exp2_times(self, scale: Self) -> Self {
        Self(self.0.map(T::exp2)) * scale
    }
    #[inline(always)]
    fn exp2(self) -> Self {
        Self(self.0.map(T::exp2))
    }
    #[inline(always)]
    fn exp(self) -> Self {
        Self(self.0.map(T::exp))
    }
    #[inline(always)]
    fn log2(self) -> Self {
        Self(self.0.map(T::log2))
    }
    #[inline(always)]
    fn normal(self) -> (Self, Self) {
        let (half, root) = (T::from_f64(0.5), T::from_f64(std::f64::consts::FRAC_1_SQRT_2));
        let scale = T::from_f64(0.398_942_280_401_432_7);
        let below = self.0.map(|x| half * (T::ONE + (x * root).erf()));
        let density = self.0.map(|x| scale * (-(half * (x * x))).exp());
        (Self(below), Self(density))
    }
    #[inline(always)]
    fn ge(self, other: Self) -> Self::Mask {
        from_fn(|i| self.0[i] >= other.0[i])
    }
    #[inline(always)]
    fn gt(self, other: Self) -> Self::Mask {
        from_fn(|i| self.0[i] > other.0[i])
    }
    #[inline(always)]
    fn only(self, mask: Self::Mask) -> Self {
        Self(from_fn(|i| if mask[i] { self.0[i] } else { T::ZERO }))
    }
    #[inline(always)]
    fn negative(self, mask: Self::Mask) -> Self {
        Self(from_fn(|i| if mask[i] { -self.0[i].abs() } else { self.0[i] }))
    }
    #[inline(always)]
    fn or(self, mask: Self::Mask, other: Self) -> Self {
        Self(from_fn(|i| if mask[i] { self.0[i] } else { other.0[i] }))
    }
    #[inline(always)]
    fn add_sums(of: &[Self; LANES], row: &mut [T; LANES]) {
        (Self::load(row) + Self::sums(of)).store(row);
    }
}

impl<T: Real> Lanes for Array<T> {
    type Part = Self;

    #[inline(always)]
    fn sums(of: &[Self; LANES]) -> Self {
        Self(sums(&of.map(|row| row.0)))
    }
    #[inline(always)]
    fn transpose(rows: &mut [Self; LANES]) {
        let old = *rows;
        for (i, row) in rows.iter_mut().enumerate() {
            *row = Self(from_fn(|j| old[j].0[i]));
        }
    }
}
