//! Portable vectors of sixteen numbers, for kernels that need more than the compiler's own vectorization: masks, fused
//! multiply-add, approximate reciprocals, transposes in registers.
//!
//! A kernel is written once, generic over [`Lanes`], as a [`LaneKernel`]; [`run`] calls it with the vector type of the
//! instruction set in use ([`simd::level`]). For `f32` that is one AVX-512 register, two AVX2 registers, four NEON
//! registers, or an array; for `f64` it is always an array. [`Level::Portable`], where there is a better one, has an
//! array whose operations are calls. A kernel with many numbers at hand may go through the parts of a vector
//! ([`Lanes::Part`]): one register, or two of NEON. Fused operations round once on processors that have them, so
//! results may differ in the last bits between instruction sets, but not between runs with the same one.
//!
//! ```
//! use weaver_kernels::lanes::{self, LANES, LaneKernel, Lanes};
//! struct Squares<'a>(&'a mut [f32; LANES]);
//! impl LaneKernel<f32> for Squares<'_> {
//!     type Output = ();
//!     #[inline(always)]
//!     fn run<V: Lanes<Scalar = f32>>(self) {
//!         let x = V::load(self.0);
//!         (x * x).store(self.0);
//!     }
//! }
//! let mut x = [3.0; LANES];
//! lanes::run(Squares(&mut x));
//! assert_eq!(x, [9.0; LANES]);
//! ```

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod called;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod eight;
#[cfg(target_arch = "aarch64")]
mod neon;
mod portable;
pub(crate) mod rows;

use crate::Real;
use crate::simd::{self, Level};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Number of lanes of a vector ([`Lanes`]).
pub const LANES: usize = 16;

/// Sixteen numbers in memory, aligned to a cache line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(64))]
pub struct Row<T>(pub [T; LANES]);

/// One bit per lane: bit i belongs to lane i.
pub trait LaneMask: Copy + Send + Sync {
    /// The mask with these bits.
    fn from_bits(bits: u16) -> Self;
    /// The bits of the mask.
    fn bits(self) -> u16;
    /// The lanes that are set in both masks.
    fn and(self, other: Self) -> Self;
    /// The lanes that are set in `self` and not in `other`.
    fn and_not(self, other: Self) -> Self;
    /// The lanes that are set in either mask.
    fn or(self, other: Self) -> Self;
}

/// A vector of numbers, sixteen or a part of sixteen: arithmetic that works lane by lane. Only the vector types of this
/// crate implement it.
pub trait Vector:
    Copy
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + sealed::Sealed
{
    /// The type of a lane.
    type Scalar: Real;
    /// The result of comparisons; bits beyond the lanes are 0.
    type Mask: LaneMask;
    /// Number of lanes, which divides [`LANES`].
    const WIDTH: usize;

    /// A vector with `x` in all lanes.
    fn splat(x: Self::Scalar) -> Self;
    /// Loads part `part` of a row: numbers `part * WIDTH..(part + 1) * WIDTH`.
    fn load_part(row: &[Self::Scalar; LANES], part: usize) -> Self;
    /// Stores the vector to part `part` of a row.
    fn store_part(self, row: &mut [Self::Scalar; LANES], part: usize);
    /// Loads vector `index` of those that sixteen rows hold one after the other.
    ///
    /// # Panics
    ///
    /// If they do not hold so many.
    #[inline(always)]
    fn load_nth(rows: &[Row<Self::Scalar>; LANES], index: usize) -> Self {
        let parts = LANES / Self::WIDTH;
        Self::load_part(&rows[index / parts].0, index % parts)
    }
    /// Stores the vector where [`load_nth`](Self::load_nth) finds it.
    ///
    /// # Panics
    ///
    /// If the rows do not hold so many.
    #[inline(always)]
    fn store_nth(self, rows: &mut [Row<Self::Scalar>; LANES], index: usize) {
        let parts = LANES / Self::WIDTH;
        self.store_part(&mut rows[index / parts].0, index % parts);
    }
    /// self * b + c, fused where the processor can.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// c - self * b, fused where the processor can.
    fn neg_mul_add(self, b: Self, c: Self) -> Self;
    /// The smaller of two numbers per lane; `other` where one is NaN.
    fn min(self, other: Self) -> Self;
    /// The larger of two numbers per lane; `other` where one is NaN.
    fn max(self, other: Self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// 1 / self within two units in the last place, for finite normal numbers with normal reciprocals.
    fn recip(self) -> Self;
    /// scale * 2^self, with a relative error within 3 * 2^-23 for -126 <= self < 127 where the result is a normal
    /// number; below that range, some number between 0 and scale * 2^-126. Faster than [`exp2`](Self::exp2) on some
    /// processors.
    fn exp2_times(self, scale: Self) -> Self;
    /// 2^self, within 3 units in the last place where the result is a normal number. Underflows gradually, overflows to
    /// infinity, NaN for NaN.
    fn exp2(self) -> Self;
    /// e^self, within 2 units in the last place where the result is a normal number; otherwise as [`exp2`](Self::exp2).
    fn exp(self) -> Self;
    /// Base-2 logarithm of positive normal numbers, within 4 units in the last place or 2^-23, whichever is larger.
    fn log2(self) -> Self;
    /// The standard normal distribution function and density at `self`. In `f32`, their relative error is within 4e-7 +
    /// 1e-7 x^2 where they are normal numbers; the portable distribution function has an absolute error within 6e-8.
    fn normal(self) -> (Self, Self);
    /// True if self >= other; false where one is NaN.
    fn ge(self, other: Self) -> Self::Mask;
    /// True if self > other; false where one is NaN.
    fn gt(self, other: Self) -> Self::Mask;
    /// True if self >= other, for the lanes of `mask`; false elsewhere.
    #[inline(always)]
    fn ge_among(self, other: Self, mask: Self::Mask) -> Self::Mask {
        self.ge(other).and(mask)
    }
    /// True if self > other, for the lanes of `mask`; false elsewhere.
    #[inline(always)]
    fn gt_among(self, other: Self, mask: Self::Mask) -> Self::Mask {
        self.gt(other).and(mask)
    }
    /// `self` where the mask is set, 0 elsewhere.
    fn only(self, mask: Self::Mask) -> Self;
    /// `self` where the mask is set, `other` elsewhere.
    fn or(self, mask: Self::Mask, other: Self) -> Self;
    /// `self` with the sign bit set where the mask is set.
    fn negative(self, mask: Self::Mask) -> Self;
    /// Adds to number i of `row` the sum of the lanes of vector i. The order of additions is the same in all
    /// instruction sets.
    fn add_sums(of: &[Self; LANES], row: &mut [Self::Scalar; LANES]);

    /// A vector with a constant in all lanes.
    #[inline(always)]
    fn constant(x: f64) -> Self {
        Self::splat(Self::Scalar::from_f64(x))
    }

    /// A vector of zeros.
    #[inline(always)]
    fn zero() -> Self {
        Self::splat(Self::Scalar::ZERO)
    }

    /// A vector whose lane i is `f(i)`.
    #[inline(always)]
    fn from_fn(mut x: impl FnMut(usize) -> Self::Scalar) -> Self {
        // `std::array::from_fn` is not always inlined.
        let mut lanes = [Self::Scalar::ZERO; LANES];
        for (lane, to) in lanes.iter_mut().take(Self::WIDTH).enumerate() {
            *to = x(lane);
        }
        Self::load_part(&lanes, 0)
    }

    /// The lanes as an array, zeros beyond them.
    #[inline(always)]
    fn to_array(self) -> [Self::Scalar; LANES] {
        let mut out = [Self::Scalar::ZERO; LANES];
        self.store_part(&mut out, 0);
        out
    }
}

/// A vector of sixteen numbers.
pub trait Lanes: Vector {
    /// The vector for kernels that have a choice, and few registers: a register's part of the sixteen, or all.
    type Part: Vector<Scalar = Self::Scalar>;
    /// Parts of a vector.
    const PARTS: usize = LANES / Self::Part::WIDTH;

    /// Loads a vector from memory.
    #[inline(always)]
    fn load(x: &[Self::Scalar; LANES]) -> Self {
        Self::load_part(x, 0)
    }
    /// Stores the vector to memory.
    #[inline(always)]
    fn store(self, to: &mut [Self::Scalar; LANES]) {
        self.store_part(to, 0);
    }
    /// The horizontal sums of sixteen vectors: lane i is the sum of the lanes of vector i. The order of additions is
    /// the same in all instruction sets.
    fn sums(of: &[Self; LANES]) -> Self;
    /// Transposes a matrix of sixteen by sixteen.
    fn transpose(rows: &mut [Self; LANES]);
}

/// Loads elements `at..at + 16` of a slice, with zeros beyond its end.
#[inline(always)]
pub fn at<V: Lanes>(x: &[V::Scalar], at: usize) -> V {
    let x = &x[at..];
    match x.first_chunk() {
        Some(x) => V::load(x),
        None => {
            let mut lanes = [V::Scalar::ZERO; LANES];
            lanes[..x.len()].copy_from_slice(x);
            V::load(&lanes)
        }
    }
}

/// Stores a vector to elements `at..at + 16` of a slice, as far as the slice goes.
#[inline(always)]
pub fn put<V: Lanes>(x: V, to: &mut [V::Scalar], at: usize) {
    let to = &mut to[at..];
    match to.first_chunk_mut() {
        Some(to) => x.store(to),
        None => to.copy_from_slice(&x.to_array()[..to.len()]),
    }
}

/// Splits a slice into whole vectors and one last vector of the remaining elements, filled up with zeros.
///
/// Loops over the whole vectors alone stay in registers; copying a few elements inside the loop would prevent that.
#[inline(always)]
pub fn split<V: Lanes>(x: &[V::Scalar]) -> (&[[V::Scalar; LANES]], V) {
    let (whole, rest) = x.as_chunks();
    (whole, if rest.is_empty() { V::zero() } else { at(rest, 0) })
}

/// Sets every element of `out` to a function of the same element of all inputs and of its old value, sixteen at a time.
/// Mark `f` `#[inline(always)]`.
#[inline(always)]
pub fn map<V: Lanes, const K: usize>(inputs: [&[V::Scalar]; K], out: &mut [V::Scalar], f: impl Fn([V; K], V) -> V) {
    let len = out.len();
    let (out, rest) = out.as_chunks_mut();
    let whole = inputs.map(
        #[inline(always)]
        |x| &x[..len].as_chunks::<LANES>().0[..out.len()],
    );
    for i in 0..out.len() {
        let mut x = [V::zero(); K];
        for k in 0..K {
            x[k] = V::load(&whole[k][i]);
        }
        f(x, V::load(&out[i])).store(&mut out[i]);
    }
    if !rest.is_empty() {
        let x = inputs.map(
            #[inline(always)]
            |x| at(x, len - rest.len()),
        );
        put(f(x, at(rest, 0)), rest, 0);
    }
}

/// A kernel that is generic over the vector type. Mark `run` and the functions in its inner loops `#[inline(always)]`.
pub trait LaneKernel<T: Real> {
    /// The result of the kernel.
    type Output;
    /// Runs the kernel with vectors of type `V`.
    fn run<V: Lanes<Scalar = T>>(self) -> Self::Output;
}

/// Runs a kernel with the vector type of the instruction set in use.
#[inline(always)]
#[allow(unsafe_code)]
pub fn run<T: Real, K: LaneKernel<T>>(kernel: K) -> K::Output {
    // SAFETY: `level` is never above the processor's detected support.
    unsafe { T::in_lanes(simd::level(), kernel) }
}

/// Runs a kernel with the vector type of a given instruction set, for tests and comparisons.
///
/// # Panics
///
/// If the processor does not support it.
#[allow(unsafe_code)]
pub fn run_at<T: Real, K: LaneKernel<T>>(level: Level, kernel: K) -> K::Output {
    assert!(simd::supports(level), "{level:?} is beyond this processor");
    // SAFETY: just checked.
    unsafe { T::in_lanes(level, kernel) }
}

/// A scalar type that has vectors. Only `f32` and `f64` implement it; call [`run`].
pub trait Laned: Sized {
    /// # Safety
    /// The processor supports `level`.
    #[doc(hidden)]
    #[allow(unsafe_code)]
    unsafe fn in_lanes<K: LaneKernel<Self>>(level: Level, kernel: K) -> K::Output
    where
        Self: Real;
}

mod sealed {
    pub trait Sealed {}
}

/// The vectors of [`Level::Portable`].
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
type Portable<T> = called::Called<T>;
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
type Portable<T> = portable::Array<T>;

impl Laned for f32 {
    #[inline(always)]
    #[allow(unsafe_code)]
    unsafe fn in_lanes<K: LaneKernel<f32>>(level: Level, kernel: K) -> K::Output {
        match level {
            // SAFETY: the caller guarantees the level.
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => unsafe { avx512::run(kernel) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => unsafe { avx2::run(kernel) },
            #[cfg(target_arch = "aarch64")]
            Level::Neon => kernel.run::<eight::Pair<neon::Quads>>(),
            _ => kernel.run::<Portable<f32>>(),
        }
    }
}

impl Laned for f64 {
    #[inline(always)]
    #[allow(unsafe_code)]
    unsafe fn in_lanes<K: LaneKernel<f64>>(level: Level, kernel: K) -> K::Output {
        // For checks of gradients and for Python: an instance for AVX-512 would cost builds more than it saves.
        match level {
            // SAFETY: the caller guarantees the level; AVX-512 comes with AVX2.
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 | Level::Avx512 => unsafe {
                simd::x86::avx2(
                    #[inline(always)]
                    || kernel.run::<portable::Array<f64>>(),
                )
            },
            #[cfg(target_arch = "aarch64")]
            Level::Neon => kernel.run::<portable::Array<f64>>(),
            _ => kernel.run::<Portable<f64>>(),
        }
    }
}
