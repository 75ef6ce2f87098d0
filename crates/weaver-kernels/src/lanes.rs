//! Sixteen numbers side by side, for kernels that need more than the compiler's own vectorization: masks, fused
//! multiply-add, approximate reciprocals, transposes in registers.
//!
//! A kernel is written once, over any [`Lanes`], as a [`LaneKernel`]; [`run`] calls it with the vector type of the
//! instruction set in use ([`simd::level`]). What `f32` gets is one AVX-512 register, two of AVX2,
//! or an array; `f64` always gets an array. Fused operations round once where the processor has them, so results
//! may differ in the last bits between instruction sets, never between runs on one.
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
mod portable;
pub(crate) mod rows;

use crate::Real;
use crate::simd::{self, Level};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Numbers in a [`Lanes`].
pub const LANES: usize = 16;

/// Sixteen numbers in memory that start a cache line, so that no vector of them straddles two.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(64))]
pub struct Row<T>(pub [T; LANES]);

/// One choice per lane; lane i is bit i.
pub trait LaneMask: Copy + Send + Sync {
    /// The mask with these bits.
    fn from_bits(bits: u16) -> Self;
    /// Its bits.
    fn bits(self) -> u16;
    /// Both.
    fn and(self, other: Self) -> Self;
    /// This but not the other.
    fn and_not(self, other: Self) -> Self;
    /// Either.
    fn or(self, other: Self) -> Self;
}

/// Sixteen numbers. Implemented by the vector types of this crate only.
pub trait Lanes:
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
    /// What a lane holds.
    type Scalar: Real;
    /// What comparisons give.
    type Mask: LaneMask;

    /// The same in all lanes.
    fn splat(x: Self::Scalar) -> Self;
    /// From memory.
    fn load(x: &[Self::Scalar; LANES]) -> Self;
    /// To memory.
    fn store(self, to: &mut [Self::Scalar; LANES]);
    /// self b + c
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// c - self b
    fn neg_mul_add(self, b: Self, c: Self) -> Self;
    /// The smaller one; `other` where they do not compare.
    fn min(self, other: Self) -> Self;
    /// The larger one; `other` where they do not compare.
    fn max(self, other: Self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// 1 / self within two units in the last place, for finite normal numbers with normal reciprocals.
    fn recip(self) -> Self;
    /// scale 2^self within 3 units in the last place for -126 <= self < 127; below, something between 0 and scale 2^-126. Faster
    /// than [`exp2`](Self::exp2) on some processors.
    fn exp2_times(self, scale: Self) -> Self;
    /// 2^self within 3 units in the last place where that is a normal number; gradual underflow, overflow to infinity, NaN
    /// stays NaN.
    fn exp2(self) -> Self;
    /// e^self within 2 units in the last place where that is a normal number; otherwise as [`exp2`](Self::exp2).
    fn exp(self) -> Self;
    /// Binary logarithm within 4 units in the last place (or 2^-23 absolute) of positive normal numbers.
    fn log2(self) -> Self;
    /// The standard normal distribution: the probability of less than self, and the density. In `f32` within 4e-7 +
    /// 1e-7 x^2 of themselves as far as they are normal numbers; the portable probability within 6e-8 absolute.
    fn normal(self) -> (Self, Self);
    /// self >= other; false where they do not compare.
    fn ge(self, other: Self) -> Self::Mask;
    /// self > other; false where they do not compare.
    fn gt(self, other: Self) -> Self::Mask;
    /// self >= other among the lanes of `mask`.
    #[inline(always)]
    fn ge_among(self, other: Self, mask: Self::Mask) -> Self::Mask {
        self.ge(other).and(mask)
    }
    /// self > other among the lanes of `mask`.
    #[inline(always)]
    fn gt_among(self, other: Self, mask: Self::Mask) -> Self::Mask {
        self.gt(other).and(mask)
    }
    /// self where the mask is set, else 0.
    fn only(self, mask: Self::Mask) -> Self;
    /// self where the mask is set, else `other`.
    fn or(self, mask: Self::Mask, other: Self) -> Self;
    /// self, with the sign bit set where the mask is.
    fn negative(self, mask: Self::Mask) -> Self;
    /// Lane i becomes the sum of the lanes of vector i; the same order of additions in all instruction sets.
    fn sums(of: &[Self; LANES]) -> Self;
    /// Rows become columns.
    fn transpose(rows: &mut [Self; LANES]);

    /// A constant in all lanes.
    #[inline(always)]
    fn constant(x: f64) -> Self {
        Self::splat(Self::Scalar::from_f64(x))
    }

    /// 0 in all lanes.
    #[inline(always)]
    fn zero() -> Self {
        Self::splat(Self::Scalar::ZERO)
    }

    /// A number for each lane.
    #[inline(always)]
    fn from_fn(mut x: impl FnMut(usize) -> Self::Scalar) -> Self {
        // The standard library's way is not surely inlined.
        let mut lanes = [Self::Scalar::ZERO; LANES];
        for (lane, to) in lanes.iter_mut().enumerate() {
            *to = x(lane);
        }
        Self::load(&lanes)
    }

    /// As an array.
    #[inline(always)]
    fn to_array(self) -> [Self::Scalar; LANES] {
        let mut out = [Self::Scalar::ZERO; LANES];
        self.store(&mut out);
        out
    }
}

/// Elements `at..at + 16` of a slice; zeros beyond its end.
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

/// Writes elements `at..at + 16` of a slice, as far as it goes.
#[inline(always)]
pub fn put<V: Lanes>(x: V, to: &mut [V::Scalar], at: usize) {
    let to = &mut to[at..];
    match to.first_chunk_mut() {
        Some(to) => x.store(to),
        None => to.copy_from_slice(&x.to_array()[..to.len()]),
    }
}

/// The whole vectors of a slice, and one more of what is left over, zeros beyond it.
///
/// Loops over whole vectors alone stay in registers, which a copy of a few elements in the midst of them would cost.
#[inline(always)]
pub fn split<V: Lanes>(x: &[V::Scalar]) -> (&[[V::Scalar; LANES]], V) {
    let (whole, rest) = x.as_chunks();
    (whole, if rest.is_empty() { V::zero() } else { at(rest, 0) })
}

/// Sets every element of `out` to `f(elements of the inputs, what is there)`, sixteen at a time. Mark `f`
/// `#[inline(always)]`.
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

/// Work that is done in lanes. Mark `run`, and what it calls in inner loops, `#[inline(always)]`.
pub trait LaneKernel<T: Real> {
    /// What comes of it.
    type Output;
    /// Does the work.
    fn run<V: Lanes<Scalar = T>>(self) -> Self::Output;
}

/// Does the work with the widest registers in use.
#[inline(always)]
#[allow(unsafe_code)]
pub fn run<T: Real, K: LaneKernel<T>>(kernel: K) -> K::Output {
    // SAFETY: `level` is never above what the processor was found to support.
    unsafe { T::in_lanes(simd::level(), kernel) }
}

/// Does the work with the registers of one instruction set, for tests and comparisons.
///
/// # Panics
///
/// If the processor does not have it.
#[allow(unsafe_code)]
pub fn run_at<T: Real, K: LaneKernel<T>>(level: Level, kernel: K) -> K::Output {
    assert!(level <= simd::supported(), "{level:?} is beyond this processor");
    // SAFETY: just checked.
    unsafe { T::in_lanes(level, kernel) }
}

/// A scalar that comes in lanes. Only `f32` and `f64` do; [`run`] is the way to it.
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

impl Laned for f32 {
    #[inline(always)]
    #[allow(unsafe_code)]
    unsafe fn in_lanes<K: LaneKernel<f32>>(level: Level, kernel: K) -> K::Output {
        #[cfg(target_arch = "x86_64")]
        match level {
            // SAFETY: the caller vouches for the level.
            Level::Avx512 => return unsafe { avx512::run(kernel) },
            // SAFETY: as above.
            Level::Avx2 => return unsafe { avx2::run(kernel) },
            Level::Portable => {}
        }
        kernel.run::<portable::Array<f32>>()
    }
}

impl Laned for f64 {
    #[inline(always)]
    #[allow(unsafe_code)]
    unsafe fn in_lanes<K: LaneKernel<f64>>(level: Level, kernel: K) -> K::Output {
        simd::dispatch_at(
            level,
            #[inline(always)]
            || kernel.run::<portable::Array<f64>>(),
        )
    }
}
