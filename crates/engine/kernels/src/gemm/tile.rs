//! The register tile of [`gemm`](super) for each instruction set: a few rows of A times a packed panel of B, with the
//! sums kept in vector registers over the whole depth.

#[cfg(target_arch = "x86_64")]
use super::pairs::gemm_pairs;
use super::{Mat, MatMut};
use crate::pages;
use crate::simd::Level;
use half::bf16;
use products::*;
use std::cell::RefCell;

mod products;

/// The operations that [`gemm`](super::gemm) needs from a scalar type. Implemented by `f32` and `f64` only.
pub trait Tile: Sized {
    /// Rows and columns of the largest tile.
    fn tile(level: Level) -> (usize, usize);

    /// Row length of a packed panel of `width` columns, at most the columns of a tile.
    fn panel_width(level: Level, width: usize) -> usize;

    /// Calls `body` with `len` elements of this thread's packing buffer, aligned to a cache line, with any content.
    fn with_panel<R>(len: usize, body: impl FnOnce(&mut [Self]) -> R) -> R;

    /// Calls `body` with `len` elements of this thread's second buffer, with any content, for a kernel that calls
    /// [`gemm_serial`](super::gemm_serial) on parts of it. `body` must not wait for other tasks: one that needs the
    /// same buffer could run on this thread meanwhile.
    fn with_scratch<R>(len: usize, body: impl FnOnce(&mut [Self]) -> R) -> R;

    /// C = alpha A B + beta C for one tile of `[rows, cols, depth]`; C is not read if `beta` is 0.
    ///
    /// # Safety
    /// `level` is supported; rows and cols are at least 1 and at most the tile's; the elements of A are readable; the
    /// panel has `depth` rows of `panel_width(level, cols)`; rows of C are writable for `cols` elements.
    #[allow(unsafe_code)]
    unsafe fn multiply(
        level: Level,
        size: [usize; 3],
        alpha: Self,
        a: LeftOperand<Self>,
        panel: *const Self,
        beta: Self,
        c: OutputRows<Self>,
    );

    /// [`gemm_half`](super::gemm_half) in pairs of bf16. Returns `c`, untouched, where there is no such instruction for
    /// this type.
    fn gemm_pairs<'c>(
        a: Mat<Self>,
        w: &[bf16],
        beta: Self,
        c: MatMut<'c, Self>,
        scratch: &mut [Self],
    ) -> Result<(), MatMut<'c, Self>>;

    /// `multiply` where every number of A and B is a pair of bf16 and their product the sum of two products.
    ///
    /// # Safety
    /// As for `multiply`, and the processor must have the instruction.
    #[allow(unsafe_code)]
    unsafe fn multiply_pairs(
        size: [usize; 3],
        a: LeftOperand<Self>,
        panel: *const Self,
        beta: Self,
        c: OutputRows<Self>,
    );

    /// C = A B + beta C for one tile of `[rows, cols]`, where row p of B begins at `b + offsets[p]`. The rows may
    /// overlap, so the windows of a convolution need no copies.
    ///
    /// # Safety
    /// As for `multiply`; `panel_width(level, cols)` elements of each row of B are readable.
    #[allow(unsafe_code)]
    unsafe fn multiply_shifted(
        level: Level,
        size: [usize; 2],
        a: LeftOperand<Self>,
        b: *const Self,
        offsets: &[usize],
        beta: Self,
        c: OutputRows<Self>,
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
        c: OutputRows<Self>,
    );
}

/// Where a tile reads A: element (i, p) is at `start + i * strides[0] + p * strides[1]`.
#[derive(Clone, Copy, Debug)]
pub struct LeftOperand<T> {
    pub start: *const T,
    pub strides: [usize; 2],
}

/// Place of a tile in C: row i begins at `start + i * stride`.
#[derive(Clone, Copy, Debug)]
pub struct OutputRows<T> {
    pub start: *mut T,
    pub stride: usize,
}

/// The most rows that [`Tile::multiply_runs`] accepts: one pointer each, as many as there are registers for.
pub const RUNS: usize = 9;

/// `len` elements of a buffer that only grows, aligned to a cache line and in huge pages.
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

/// Defines the products in pairs of bf16, which only `f32` has.
macro_rules! pairs {
    (of_bf16) => {
        fn gemm_pairs<'c>(
            a: Mat<f32>,
            w: &[bf16],
            beta: f32,
            c: MatMut<'c, f32>,
            scratch: &mut [f32],
        ) -> Result<(), MatMut<'c, f32>> {
            #[cfg(target_arch = "x86_64")]
            if crate::simd::level() == Level::Avx512 && is_x86_feature_detected!("avx512bf16") {
                gemm_pairs(a, w, beta, c, scratch);
                return Ok(());
            }
            let _ = (a, w, beta, scratch);
            Err(c)
        }

        #[allow(unsafe_code)]
        unsafe fn multiply_pairs(
            size: [usize; 3],
            a: LeftOperand<f32>,
            panel: *const f32,
            beta: f32,
            c: OutputRows<f32>,
        ) {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the caller guarantees the instruction set and the memory.
            unsafe {
                avx512_pairs::multiply(size, 1.0, a, panel, beta, c);
            }
            #[cfg(not(target_arch = "x86_64"))]
            unreachable!("no products of pairs: {:?}", (size, a, panel, beta, c));
        }
    };
    (none) => {
        fn gemm_pairs<'c>(
            _: Mat<Self>,
            _: &[bf16],
            _: Self,
            c: MatMut<'c, Self>,
            _: &mut [Self],
        ) -> Result<(), MatMut<'c, Self>> {
            Err(c)
        }

        #[allow(unsafe_code)]
        unsafe fn multiply_pairs(_: [usize; 3], _: LeftOperand<Self>, _: *const Self, _: Self, _: OutputRows<Self>) {
            unreachable!("no products of pairs");
        }
    };
}

macro_rules! scalar {
    ($t:ty, $avx512:ident, $avx2:ident, $neon:ident, $portable:ident, $pairs:ident) => {
        impl Tile for $t {
            #[inline]
            fn tile(level: Level) -> (usize, usize) {
                match level {
                    #[cfg(target_arch = "x86_64")]
                    Level::Avx512 => ($avx512::ROWS, 2 * $avx512::LANES),
                    #[cfg(target_arch = "x86_64")]
                    Level::Avx2 => ($avx2::ROWS, 2 * $avx2::LANES),
                    #[cfg(target_arch = "aarch64")]
                    Level::Neon => ($neon::ROWS, 2 * $neon::LANES),
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
                a: LeftOperand<Self>,
                panel: *const Self,
                beta: Self,
                c: OutputRows<Self>,
            ) {
                // SAFETY: the caller guarantees the instruction set and the memory.
                unsafe {
                    match level {
                        #[cfg(target_arch = "x86_64")]
                        Level::Avx512 => $avx512::multiply(size, alpha, a, panel, beta, c),
                        #[cfg(target_arch = "x86_64")]
                        Level::Avx2 => $avx2::multiply(size, alpha, a, panel, beta, c),
                        #[cfg(target_arch = "aarch64")]
                        Level::Neon => $neon::multiply(size, alpha, a, panel, beta, c),
                        _ => $portable::multiply(size, alpha, a, panel, beta, c),
                    }
                }
            }

            pairs!($pairs);

            #[allow(unsafe_code)]
            unsafe fn multiply_shifted(
                level: Level,
                size: [usize; 2],
                a: LeftOperand<Self>,
                b: *const Self,
                offsets: &[usize],
                beta: Self,
                c: OutputRows<Self>,
            ) {
                // SAFETY: the caller guarantees the instruction set and the memory.
                unsafe {
                    match level {
                        #[cfg(target_arch = "x86_64")]
                        Level::Avx512 => $avx512::multiply_shifted(size, a, b, offsets, beta, c),
                        #[cfg(target_arch = "x86_64")]
                        Level::Avx2 => $avx2::multiply_shifted(size, a, b, offsets, beta, c),
                        #[cfg(target_arch = "aarch64")]
                        Level::Neon => $neon::multiply_shifted(size, a, b, offsets, beta, c),
                        _ => $portable::multiply_shifted(size, a, b, offsets, beta, c),
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
                c: OutputRows<Self>,
            ) {
                // SAFETY: the caller guarantees the instruction set and the memory.
                unsafe {
                    match level {
                        #[cfg(target_arch = "x86_64")]
                        Level::Avx512 => $avx512::multiply_runs(size, a, offsets, panel, beta, c),
                        #[cfg(target_arch = "x86_64")]
                        Level::Avx2 => $avx2::multiply_runs(size, a, offsets, panel, beta, c),
                        #[cfg(target_arch = "aarch64")]
                        Level::Neon => $neon::multiply_runs(size, a, offsets, panel, beta, c),
                        _ => $portable::multiply_runs(size, a, offsets, panel, beta, c),
                    }
                }
            }
        }
    };
}

scalar!(f32, avx512_f32, avx2_f32, neon_f32, portable_f32, of_bf16);
scalar!(f64, avx512_f64, avx2_f64, neon_f64, portable_f64, none);
