//! Run-time CPU dispatch: safe code that is compiled for several instruction sets and runs with the best one.
//!
//! [`dispatch`] runs a closure inside a function compiled for AVX-512, for AVX2 with FMA, or for the baseline of the
//! target, which on ARM has NEON, whichever is the best that the processor supports. The compiler vectorizes plain
//! loops over slices in the closure with those registers, without intrinsics. It never fuses or reorders floating-point
//! operations on its own, so the results are the same with every instruction set.
//!
//! Mark the closure, closures inside it, and every function called in its inner loops `#[inline(always)]`; code that is
//! not inlined uses the baseline instructions. Plain `for` loops are inlined more reliably than `for_each` with a long
//! closure. Keep parallel loops outside and dispatch inside each chunk. In `f32`, call `Real::exp(x)` rather than
//! `x.exp()`, which is the standard library's and does not vectorize.

use std::env::VarError;
use std::sync::OnceLock;

/// An instruction set that [`dispatch`] compiles for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// The baseline of the compilation target.
    Portable,
    /// NEON, of every 64-bit ARM processor: 4 lanes of `f32`, used in pairs.
    Neon,
    /// AVX2, FMA and the bit counts that come with them: 8 lanes of `f32`.
    Avx2,
    /// AVX-512 F, VL, BW and DQ: 16 lanes of `f32`.
    Avx512,
}

/// The instruction set in use: the best one that this processor supports, or a lesser one by the environment variable
/// `WEAVER_SIMD` (`portable`, `neon`, `avx2` or `avx512`). The variable is read once.
///
/// # Panics
///
/// If `WEAVER_SIMD` has another value; [`requested_level`] checks it without a panic.
#[inline]
pub fn level() -> Level {
    static LEVEL: OnceLock<Level> = OnceLock::new();
    *LEVEL.get_or_init(|| {
        let requested = requested_level().unwrap_or_else(|error| panic!("{error}"));
        levels_to(requested).last().unwrap_or(Level::Portable)
    })
}

/// The instruction sets that can be tried: those that this processor supports, up to the one in use.
///
/// ```
/// use weaver_kernels::simd::{Level, level, levels};
/// assert_eq!(levels().next(), Some(Level::Portable));
/// assert_eq!(levels().last(), Some(level()));
/// ```
pub fn levels() -> impl Iterator<Item = Level> {
    levels_to(level())
}

/// The supported instruction sets up to `best`, from the least.
fn levels_to(best: Level) -> impl Iterator<Item = Level> {
    [Level::Portable, Level::Neon, Level::Avx2, Level::Avx512].into_iter().filter(move |l| *l <= best && supports(*l))
}

/// The instruction set named by `WEAVER_SIMD`, or the best one if the variable is not set.
///
/// Programs call this at the start, to report a wrong value as an error.
pub fn requested_level() -> Result<Level, String> {
    match std::env::var("WEAVER_SIMD").as_deref() {
        Ok("portable") => Ok(Level::Portable),
        Ok("neon") => Ok(Level::Neon),
        Ok("avx2") => Ok(Level::Avx2),
        Ok("avx512") | Err(VarError::NotPresent) => Ok(Level::Avx512),
        other => {
            Err(format!("the environment variable WEAVER_SIMD is {other:?}; expected portable, neon, avx2 or avx512"))
        }
    }
}

/// True if this processor has the instruction set.
pub(crate) fn supports(level: Level) -> bool {
    match level {
        Level::Portable => true,
        Level::Neon => cfg!(target_arch = "aarch64"),
        Level::Avx2 | Level::Avx512 => level <= best_of_x86(),
    }
}

#[cfg(target_arch = "x86_64")]
fn best_of_x86() -> Level {
    let avx2 = is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("fma")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("popcnt")
        && is_x86_feature_detected!("lzcnt");
    let avx512 = avx2
        && is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq");
    match (avx512, avx2) {
        (true, _) => Level::Avx512,
        (_, true) => Level::Avx2,
        _ => Level::Portable,
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn best_of_x86() -> Level {
    Level::Portable
}

/// Runs `body`, compiled for the instruction set in use ([`level`]).
///
/// ```
/// use weaver_kernels::{Real, simd};
/// let mut x = [0.0_f32, 1.0, -1.0, 0.5];
/// simd::dispatch(
///     #[inline(always)]
///     || {
///         for x in &mut x {
///             *x = Real::exp(*x);
///         }
///     },
/// );
/// assert_eq!(x[0], 1.0);
/// ```
#[inline(always)]
pub fn dispatch<R>(body: impl FnOnce() -> R) -> R {
    dispatch_at(level(), body)
}

/// Runs `body`, compiled for `level`, which the processor must support.
#[inline(always)]
pub(crate) fn dispatch_at<R>(level: Level, body: impl FnOnce() -> R) -> R {
    #[allow(unsafe_code)]
    match level {
        // SAFETY: callers in this crate never pass a level that the processor does not support.
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => unsafe { x86::avx512(body) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => unsafe { x86::avx2(body) },
        // NEON belongs to the baseline.
        _ => body(),
    }
}

/// Prefetches the cache line at `x`: a hint for access patterns that the processor cannot predict.
#[inline(always)]
pub fn prefetch<T>(x: *const T) {
    #[cfg(target_arch = "x86_64")]
    #[allow(unsafe_code)]
    // SAFETY: SSE is part of the baseline; a prefetch neither reads nor faults.
    unsafe {
        std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(x.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = x;
}

#[cfg(target_arch = "x86_64")]
pub(crate) mod x86 {
    #[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq,avx2,fma")]
    pub fn avx512<R>(body: impl FnOnce() -> R) -> R {
        body()
    }

    #[target_feature(enable = "avx2,fma")]
    pub fn avx2<R>(body: impl FnOnce() -> R) -> R {
        body()
    }
}
