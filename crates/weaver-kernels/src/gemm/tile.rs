//! The register tile of [`gemm`](super): a few rows of A times a packed panel of B, kept in vector
//! registers over the whole depth, for each instruction set.

use super::half_precision::gemm_pairs;
use crate::pages;
use crate::simd::{Level, level};
use half::bf16;
use products::*;
use std::cell::RefCell;

mod products;

/// What [`gemm`](super::gemm) needs of a scalar. Only `f32` and `f64` have it.
pub trait Tile: Sized {
    /// Rows and columns of the largest tile.
    fn tile(level: Level) -> (usize, usize);

    /// Row length of the packed panel for `width` <= tile columns.
    fn panel_width(level: Level, width: usize) -> usize;

    /// Lends this thread's packing buffer, at least `len` long, aligned to a cache line.
    fn with_panel<R>(len: usize, body: impl FnOnce(&mut [Self]) -> R) -> R;

    /// Lends this thread's other buffer, `len` long with any content, to a kernel that calls
    /// [`gemm_serial`](super::gemm_serial) on parts of it. `body` must not wait for other tasks: another
    /// one that wants the buffer could run meanwhile.
    fn with_scratch<R>(len: usize, body: impl FnOnce(&mut [Self]) -> R) -> R;

    /// C = alpha A B + beta C for one tile of `[rows, cols, depth]`; C is not read if `beta` is 0.
    ///
    /// # Safety
    /// `level` is supported; rows and cols are at least 1 and at most the tile's; element (i, p) of A at
    /// `a[i * strides[0] + p * strides[1]]` is readable; the panel has `depth` rows of
    /// `panel_width(level, cols)`; rows of C, `c_stride` apart, are writable for `cols` elements.
    #[allow(unsafe_code)]
    unsafe fn multiply(
        level: Level,
        size: [usize; 3],
        alpha: Self,
        a: *const Self,
        strides: [usize; 2],
        panel: *const Self,
        beta: Self,
        c: *mut Self,
        c_stride: usize,
    );

    /// [`gemm_half`](super::gemm_half) of `[m, n, k]` in pairs of bf16; false, and nothing done, where there is no such
    /// instruction for this type.
    fn gemm_pairs(size: [usize; 3], a: &[Self], w: &[bf16], beta: Self, c: &mut [Self], scratch: &mut [Self]) -> bool;

    /// `multiply` where every number of A and B is a pair of bf16 and their product the sum of two products.
    ///
    /// # Safety
    /// As for `multiply`, and the processor must have the instruction.
    #[allow(unsafe_code)]
    unsafe fn multiply_pairs(
        size: [usize; 3],
        a: *const Self,
        strides: [usize; 2],
        panel: *const Self,
        beta: Self,
        c: *mut Self,
        c_stride: usize,
    );

    /// C = A B + beta C for one tile of `[rows, cols]`, where row p of B begins at `b + offsets[p]`, wherever that is: windows
    /// of a map that overlap need no copies.
    ///
    /// # Safety
    /// As for `multiply`; `panel_width(level, cols)` elements of each row of B are readable.
    #[allow(unsafe_code)]
    unsafe fn multiply_shifted(
        level: Level,
        size: [usize; 2],
        a: *const Self,
        strides: [usize; 2],
        b: *const Self,
        offsets: &[usize],
        beta: Self,
        c: *mut Self,
        c_stride: usize,
    );

    /// C = A B + beta C for one tile, where row i of A is `count` runs of `depth` elements, `step` apart, the first at
    /// `a + offsets[i]`: `size` is `[cols, depth, count, step]`. B is a panel of `count * depth` rows.
    ///
    /// # Safety
    /// As for `multiply`, with at most [`RUNS`] rows.
    #[allow(unsafe_code)]
    unsafe fn multiply_runs(
        level: Level,
        size: [usize; 4],
        a: *const Self,
        offsets: &[usize],
        panel: *const Self,
        beta: Self,
        c: *mut Self,
        c_stride: usize,
    );
}

/// Rows that [`Tile::multiply_runs`] takes at most: as many pointers as there are registers for.
pub const RUNS: usize = 9;

/// `len` elements of a buffer that only grows, from a cache line's start, in huge pages.
fn aligned<T: Copy>(buffer: &mut Vec<T>, len: usize, zero: T) -> &mut [T] {
    let line = 64 / size_of::<T>();
    if buffer.len() < len + line {
        let room = (len + line).next_power_of_two();
        buffer.reserve_exact(room - buffer.len());
        pages::prefer_huge(buffer.spare_capacity_mut());
        buffer.resize(room, zero);
    }
    let skip = buffer.as_ptr().align_offset(64).min(line);
    &mut buffer[skip..skip + len]
}

/// The products of pairs of bf16 that a type has.
macro_rules! pairs {
    (of_bf16) => {
        fn gemm_pairs(size: [usize; 3], a: &[f32], w: &[bf16], beta: f32, c: &mut [f32], scratch: &mut [f32]) -> bool {
            #[cfg(target_arch = "x86_64")]
            if level() == Level::Avx512 && is_x86_feature_detected!("avx512bf16") {
                gemm_pairs(size, a, w, beta, c, scratch);
                return true;
            }
            let _ = (size, a, w, beta, c, scratch);
            false
        }

        #[allow(unsafe_code)]
        unsafe fn multiply_pairs(
            size: [usize; 3],
            a: *const f32,
            strides: [usize; 2],
            panel: *const f32,
            beta: f32,
            c: *mut f32,
            c_stride: usize,
        ) {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the caller vouches for the processor and the memory.
            unsafe {
                avx512_pairs::multiply(size, 1.0, a, strides, panel, beta, c, c_stride);
            }
            #[cfg(not(target_arch = "x86_64"))]
            unreachable!("no products of pairs: {:?}", (size, a, strides, panel, beta, c, c_stride));
        }
    };
    (none) => {
        fn gemm_pairs(_: [usize; 3], _: &[Self], _: &[bf16], _: Self, _: &mut [Self], _: &mut [Self]) -> bool {
            false
        }

        #[allow(unsafe_code)]
        unsafe fn multiply_pairs(
            _: [usize; 3],
            _: *const Self,
            _: [usize; 2],
            _: *const Self,
            _: Self,
            _: *mut Self,
            _: usize,
        ) {
            unreachable!("no products of pairs");
        }
    };
}

macro_rules! scalar {
    ($t:ty, $avx512:ident, $avx2:ident, $portable:ident, $pairs:ident) => {
        impl Tile for $t {
            #[inline]
            fn tile(level: Level) -> (usize, usize) {
                match level {
                    #[cfg(target_arch = "x86_64")]
                    Level::Avx512 => ($avx512::ROWS, 2 * $avx512::LANES),
                    #[cfg(target_arch = "x86_64")]
                    Level::Avx2 => ($avx2::ROWS, 2 * $avx2::LANES),
                    _ => ($portable::ROWS, 2 * $portable::LANES),
                }
            }

            #[inline]
            fn panel_width(level: Level, width: usize) -> usize {
                let (_, cols) = Self::tile(level);
                if width <= cols / 2 { cols / 2 } else { cols }
            }

            fn with_panel<R>(len: usize, body: impl FnOnce(&mut [Self]) -> R) -> R {
                thread_local!(static PANEL: RefCell<Vec<$t>> = const { RefCell::new(Vec::new()) });
                PANEL.with_borrow_mut(|panel| body(aligned(panel, len, 0.0)))
            }

            fn with_scratch<R>(len: usize, body: impl FnOnce(&mut [Self]) -> R) -> R {
                thread_local!(static SCRATCH: RefCell<Vec<$t>> = const { RefCell::new(Vec::new()) });
                SCRATCH.with_borrow_mut(|scratch| body(aligned(scratch, len, 0.0)))
            }

            #[allow(unsafe_code)]
            unsafe fn multiply(
                level: Level,
                size: [usize; 3],
                alpha: Self,
                a: *const Self,
                strides: [usize; 2],
                panel: *const Self,
                beta: Self,
                c: *mut Self,
                c_stride: usize,
            ) {
                // SAFETY: the caller vouches for the level and the memory.
                unsafe {
                    match level {
                        #[cfg(target_arch = "x86_64")]
                        Level::Avx512 => $avx512::multiply(size, alpha, a, strides, panel, beta, c, c_stride),
                        #[cfg(target_arch = "x86_64")]
                        Level::Avx2 => $avx2::multiply(size, alpha, a, strides, panel, beta, c, c_stride),
                        _ => $portable::multiply(size, alpha, a, strides, panel, beta, c, c_stride),
                    }
                }
            }

            pairs!($pairs);

            #[allow(unsafe_code)]
            unsafe fn multiply_shifted(
                level: Level,
                size: [usize; 2],
                a: *const Self,
                strides: [usize; 2],
                b: *const Self,
                offsets: &[usize],
                beta: Self,
                c: *mut Self,
                c_stride: usize,
            ) {
                // SAFETY: the caller vouches for the level and the memory.
                unsafe {
                    match level {
                        #[cfg(target_arch = "x86_64")]
                        Level::Avx512 => $avx512::multiply_shifted(size, a, strides, b, offsets, beta, c, c_stride),
                        #[cfg(target_arch = "x86_64")]
                        Level::Avx2 => $avx2::multiply_shifted(size, a, strides, b, offsets, beta, c, c_stride),
                        _ => $portable::multiply_shifted(size, a, strides, b, offsets, beta, c, c_stride),
                    }
                }
            }

            #[allow(unsafe_code)]
            unsafe fn multiply_runs(
                level: Level,
                size: [usize; 4],
                a: *const Self,
                offsets: &[usize],
                panel: *const Self,
                beta: Self,
                c: *mut Self,
                c_stride: usize,
            ) {
                // SAFETY: the caller vouches for the level and the memory.
                unsafe {
                    match level {
                        #[cfg(target_arch = "x86_64")]
                        Level::Avx512 => $avx512::multiply_runs(size, a, offsets, panel, beta, c, c_stride),
                        #[cfg(target_arch = "x86_64")]
                        Level::Avx2 => $avx2::multiply_runs(size, a, offsets, panel, beta, c, c_stride),
                        _ => $portable::multiply_runs(size, a, offsets, panel, beta, c, c_stride),
                    }
                }
            }
        }
    };
}

scalar!(f32, avx512_f32, avx2_f32, portable_f32, of_bf16);
scalar!(f64, avx512_f64, avx2_f64, portable_f64, none);
