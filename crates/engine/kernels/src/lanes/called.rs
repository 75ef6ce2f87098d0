//! Vectors for x86 processors without AVX2, and for comparisons on ARM: an [`Array`] whose operations are calls.
//!
//! Each kernel is compiled for each vector type. Arrays inlined into a kernel need more registers than there are, so
//! that the code for processors that few people have took a third of the time that the rasterizer's kernels take to
//! compile. With calls it takes little, and such a processor about twice as long to draw. Results are the same bits as
//! those of an [`Array`].

use super::portable::Array;
use super::{LANES, LaneMask, Lanes, Vector, sealed::Sealed};
use crate::Real;
use std::ops::{Add, Div, Mul, Neg, Sub};

#[derive(Clone, Copy)]
pub struct Called<T>(Array<T>);

impl<T> Sealed for Called<T> {}

/// Bits as they are, which AVX-512 has, too.
impl LaneMask for u16 {
    #[inline(always)]
    fn from_bits(bits: u16) -> Self {
        bits
    }
    #[inline(always)]
    fn bits(self) -> u16 {
        self
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        self & other
    }
    #[inline(always)]
    fn and_not(self, other: Self) -> Self {
        self & !other
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        self | other
    }
}

/// Operations of an [`Array`] that take vectors and give a vector.
macro_rules! calls {
    ($($name:ident($($x:ident),*)),* $(,)?) => {
        $(
            #[inline(never)]
            fn $name(self $(, $x: Self)*) -> Self {
                Self(self.0.$name($($x.0),*))
            }
        )*
    };
}

macro_rules! operators {
    ($($trait:ident $name:ident($($x:ident)?)),*) => {
        $(
            impl<T: Real> $trait for Called<T> {
                type Output = Self;
                calls!($name($($x)?));
            }
        )*
    };
}
operators!(Add add(other), Sub sub(other), Mul mul(other), Div div(other), Neg neg());

impl<T: Real> Vector for Called<T> {
    type Scalar = T;
    type Mask = u16;
    const WIDTH: usize = LANES;

    calls!(mul_add(b, c), neg_mul_add(b, c), min(other), max(other), abs(), sqrt(), recip());
    calls!(exp2_times(scale), exp2(), exp(), log2());

    // Calls, too: one access to a part of an array, and the compiler would hold all sixteen numbers apart.
    #[inline(never)]
    fn splat(x: T) -> Self {
        Self(Array::splat(x))
    }
    #[inline(never)]
    fn load_part(row: &[T; LANES], part: usize) -> Self {
        Self(Array::load_part(row, part))
    }
    #[inline(never)]
    fn store_part(self, row: &mut [T; LANES], part: usize) {
        self.0.store_part(row, part);
    }
    #[inline(never)]
    fn normal(self) -> (Self, Self) {
        let (below, density) = self.0.normal();
        (Self(below), Self(density))
    }
    #[inline(never)]
    fn ge(self, other: Self) -> u16 {
        self.0.ge(other.0).bits()
    }
    #[inline(never)]
    fn gt(self, other: Self) -> u16 {
        self.0.gt(other.0).bits()
    }
    #[inline(never)]
    fn only(self, mask: u16) -> Self {
        Self(self.0.only(LaneMask::from_bits(mask)))
    }
    #[inline(never)]
    fn or(self, mask: u16, other: Self) -> Self {
        Self(self.0.or(LaneMask::from_bits(mask), other.0))
    }
    #[inline(never)]
    fn negative(self, mask: u16) -> Self {
        Self(self.0.negative(LaneMask::from_bits(mask)))
    }
    #[inline(never)]
    fn add_sums(of: &[Self; LANES], row: &mut [T; LANES]) {
        Array::add_sums(&of.map(|x| x.0), row);
    }
}

impl<T: Real> Lanes for Called<T> {
    type Part = Self;

    #[inline(never)]
    fn sums(of: &[Self; LANES]) -> Self {
        Self(Array::sums(&of.map(|x| x.0)))
    }
    #[inline(never)]
    fn transpose(rows: &mut [Self; LANES]) {
        let mut arrays = rows.map(|row| row.0);
        Array::transpose(&mut arrays);
        *rows = arrays.map(Self);
    }
}
