//! The register tile of [`gemm`](super): a few rows of A times a packed panel of B, kept in vector
//! registers over the whole depth, for each instruction set.

use crate::simd::Level;
use std::cell::RefCell;

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

/// Defines `multiply` for one vector type in terms of the functions in scope: `zero`, `splat`, `load`,
/// `store`, `load_part`, `store_part`, `mul`, `mul_add`; a tile is `$rows` high, two vectors wide.
macro_rules! tile {
    ($t:ty, $rows:literal: $($row:literal)*, $(#[$feature:meta])*) => {
        pub const ROWS: usize = $rows;

        $(#[$feature])*
        pub unsafe fn multiply(
            size: [usize; 3], alpha: $t, a: *const $t, strides: [usize; 2], panel: *const $t, beta: $t, c: *mut $t, c_stride: usize,
        ) {
            let [rows, cols, depth] = size;
            // SAFETY: passed on from the caller.
            unsafe {
                match (rows, cols <= LANES) {
                    $(
                        ($row, true) => tile::<$row, 1>(cols, depth, alpha, a, strides, panel, beta, c, c_stride),
                        ($row, false) => tile::<$row, 2>(cols, depth, alpha, a, strides, panel, beta, c, c_stride),
                    )*
                    _ => unreachable!("a tile has 1 to {ROWS} rows"),
                }
            }
        }

        $(#[$feature])*
        unsafe fn tile<const M: usize, const V: usize>(
            cols: usize, depth: usize, alpha: $t, a: *const $t, strides: [usize; 2], panel: *const $t, beta: $t, c: *mut $t, c_stride: usize,
        ) {
            let mut sums = [[zero(); V]; M];
            // SAFETY: all offsets are inside what the caller vouches for.
            unsafe {
                fetch::<M, V>(cols, c, c_stride);
                for p in 0..depth {
                    let mut b = [zero(); V];
                    for v in 0..V {
                        b[v] = load(panel.add((p * V + v) * LANES));
                    }
                    for i in 0..M {
                        let x = splat(*a.add(i * strides[0] + p * strides[1]));
                        for v in 0..V {
                            sums[i][v] = mul_add(x, b[v], sums[i][v]);
                        }
                    }
                }
                let plain = alpha == 1.0 && beta == 0.0 && cols == V * LANES;
                for i in 0..M {
                    for v in 0..V {
                        let c = c.add(i * c_stride + v * LANES);
                        if plain {
                            store(c, sums[i][v]);
                        } else {
                            finish(sums[i][v], cols - v * LANES, alpha, beta, c);
                        }
                    }
                }
            }
        }

        $(#[$feature])*
        pub unsafe fn multiply_shifted(
            size: [usize; 2], a: *const $t, strides: [usize; 2], b: *const $t, offsets: &[usize], beta: $t, c: *mut $t, c_stride: usize,
        ) {
            let [rows, cols] = size;
            // SAFETY: passed on from the caller.
            unsafe {
                match (rows, cols <= LANES) {
                    $(
                        ($row, true) => shifted::<$row, 1>(cols, a, strides, b, offsets, beta, c, c_stride),
                        ($row, false) => shifted::<$row, 2>(cols, a, strides, b, offsets, beta, c, c_stride),
                    )*
                    _ => unreachable!("a tile has 1 to {ROWS} rows"),
                }
            }
        }

        $(#[$feature])*
        unsafe fn shifted<const M: usize, const V: usize>(
            cols: usize, a: *const $t, strides: [usize; 2], b: *const $t, offsets: &[usize], beta: $t, c: *mut $t, c_stride: usize,
        ) {
            let mut sums = [[zero(); V]; M];
            // SAFETY: all offsets are inside what the caller vouches for.
            unsafe {
                fetch::<M, V>(cols, c, c_stride);
                for (p, offset) in offsets.iter().enumerate() {
                    let mut row = [zero(); V];
                    for v in 0..V {
                        row[v] = load(b.add(offset + v * LANES));
                    }
                    for i in 0..M {
                        let x = splat(*a.add(i * strides[0] + p * strides[1]));
                        for v in 0..V {
                            sums[i][v] = mul_add(x, row[v], sums[i][v]);
                        }
                    }
                }
                let plain = beta == 0.0 && cols == V * LANES;
                for i in 0..M {
                    for v in 0..V {
                        let c = c.add(i * c_stride + v * LANES);
                        if plain {
                            store(c, sums[i][v]);
                        } else {
                            finish(sums[i][v], cols - v * LANES, 1.0, beta, c);
                        }
                    }
                }
            }
        }

        $(#[$feature])*
        pub unsafe fn multiply_runs(
            size: [usize; 4], a: *const $t, offsets: &[usize], panel: *const $t, beta: $t, c: *mut $t, c_stride: usize,
        ) {
            // SAFETY: passed on from the caller.
            unsafe {
                match (offsets.len(), size[0] <= LANES) {
                    $(
                        ($row, true) => runs::<$row, 1>(size, a, offsets, panel, beta, c, c_stride),
                        ($row, false) => runs::<$row, 2>(size, a, offsets, panel, beta, c, c_stride),
                    )*
                    _ => unreachable!("a tile has 1 to {ROWS} rows"),
                }
            }
        }

        $(#[$feature])*
        unsafe fn runs<const M: usize, const V: usize>(
            size: [usize; 4], a: *const $t, offsets: &[usize], mut panel: *const $t, beta: $t, c: *mut $t, c_stride: usize,
        ) {
            let [cols, depth, count, step] = size;
            let mut sums = [[zero(); V]; M];
            // SAFETY: all offsets are inside what the caller vouches for.
            unsafe {
                fetch::<M, V>(cols, c, c_stride);
                for run in 0..count {
                    let mut rows = [a; M];
                    for (row, offset) in rows.iter_mut().zip(offsets) {
                        *row = a.add(offset + run * step);
                    }
                    for p in 0..depth {
                        let mut b = [zero(); V];
                        for v in 0..V {
                            b[v] = load(panel.add(v * LANES));
                        }
                        panel = panel.add(V * LANES);
                        for i in 0..M {
                            let x = splat(*rows[i].add(p));
                            for v in 0..V {
                                sums[i][v] = mul_add(x, b[v], sums[i][v]);
                            }
                        }
                    }
                }
                let plain = beta == 0.0 && cols == V * LANES;
                for i in 0..M {
                    for v in 0..V {
                        let c = c.add(i * c_stride + v * LANES);
                        if plain {
                            store(c, sums[i][v]);
                        } else {
                            finish(sums[i][v], cols - v * LANES, 1.0, beta, c);
                        }
                    }
                }
            }
        }

        /// C is wanted after the loop over the depth, and comes from far away meanwhile.
        $(#[$feature])*
        #[inline]
        fn fetch<const M: usize, const V: usize>(cols: usize, c: *const $t, c_stride: usize) {
            for i in 0..M {
                for v in 0..V.min(cols.div_ceil(LANES)) {
                    crate::simd::prefetch(c.wrapping_add(i * c_stride + v * LANES));
                }
            }
        }

        /// C = alpha sum + beta C for `cols` elements of one vector, or all of it.
        $(#[$feature])*
        #[inline]
        unsafe fn finish(sum: Vector, cols: usize, alpha: $t, beta: $t, c: *mut $t) {
            let (scale, mut sum) = (splat(beta), mul(splat(alpha), sum));
            // SAFETY: the caller vouches for the elements.
            unsafe {
                if cols >= LANES {
                    if beta != 0.0 {
                        sum = mul_add(scale, load(c), sum);
                    }
                    store(c, sum);
                } else {
                    if beta != 0.0 {
                        sum = mul_add(scale, load_part(c, cols), sum);
                    }
                    store_part(c, cols, sum);
                }
            }
        }
    };
}

/// The vector functions of one instruction set, and the tile made of them.
#[cfg(target_arch = "x86_64")]
macro_rules! vector_tile {
    (
        $name:ident, $features:literal, $t:ty, $v:ty, $lanes:literal, $rows:literal: $($row:literal)*,
        $zero:ident, $splat:ident, $load:ident, $store:ident, $mul:ident, $mul_add:ident,
        $mask:expr, $load_part:ident($($load_arg:ident)*), $store_part:ident
    ) => {
        #[allow(unsafe_code)]
        pub mod $name {
            use std::arch::x86_64::*;

            pub const LANES: usize = $lanes;
            type Vector = $v;

            #[inline]
            #[target_feature(enable = $features)]
            fn zero() -> $v {
                $zero()
            }
            #[inline]
            #[target_feature(enable = $features)]
            fn splat(x: $t) -> $v {
                $splat(x)
            }
            #[inline]
            #[target_feature(enable = $features)]
            fn mul(a: $v, b: $v) -> $v {
                $mul(a, b)
            }
            #[inline]
            #[target_feature(enable = $features)]
            fn mul_add(a: $v, b: $v, c: $v) -> $v {
                $mul_add(a, b, c)
            }
            #[inline]
            #[target_feature(enable = $features)]
            unsafe fn load(p: *const $t) -> $v {
                // SAFETY: the caller vouches for LANES elements.
                unsafe { $load(p) }
            }
            #[inline]
            #[target_feature(enable = $features)]
            unsafe fn store(p: *mut $t, x: $v) {
                // SAFETY: the caller vouches for LANES elements.
                unsafe { $store(p, x) }
            }
            #[inline]
            #[target_feature(enable = $features)]
            unsafe fn load_part(p: *const $t, count: usize) -> $v {
                // SAFETY: masked lanes are not touched; the caller vouches for `count` elements.
                unsafe {
                    let mask = $mask(count);
                    vector_tile!(@load $load_part, mask, p, $($load_arg)*)
                }
            }
            #[inline]
            #[target_feature(enable = $features)]
            unsafe fn store_part(p: *mut $t, count: usize, x: $v) {
                // SAFETY: masked lanes are not touched; the caller vouches for `count` elements.
                unsafe { $store_part(p, $mask(count), x) }
            }

            tile!($t, $rows: $($row)*, #[target_feature(enable = $features)]);
        }
    };
    (@load $load:ident, $mask:ident, $p:ident, mask_first) => { $load($mask, $p) };
    (@load $load:ident, $mask:ident, $p:ident, mask_last) => { $load($p, $mask) };
}

/// Eight set lanes and eight clear ones: a window of it is a mask for the first `count` lanes.
#[cfg(target_arch = "x86_64")]
static WINDOW: [i32; 16] = [-1, -1, -1, -1, -1, -1, -1, -1, 0, 0, 0, 0, 0, 0, 0, 0];

#[cfg(target_arch = "x86_64")]
vector_tile!(
    avx512_f32, "avx512f", f32, __m512, 16, 12: 1 2 3 4 5 6 7 8 9 10 11 12,
    _mm512_setzero_ps, _mm512_set1_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_mul_ps, _mm512_fmadd_ps,
    (|count: usize| ((1_u32 << count) - 1) as __mmask16), _mm512_maskz_loadu_ps(mask_first), _mm512_mask_storeu_ps
);
#[cfg(target_arch = "x86_64")]
vector_tile!(
    avx512_f64, "avx512f", f64, __m512d, 8, 12: 1 2 3 4 5 6 7 8 9 10 11 12,
    _mm512_setzero_pd, _mm512_set1_pd, _mm512_loadu_pd, _mm512_storeu_pd, _mm512_mul_pd, _mm512_fmadd_pd,
    (|count: usize| ((1_u32 << count) - 1) as __mmask8), _mm512_maskz_loadu_pd(mask_first), _mm512_mask_storeu_pd
);
#[cfg(target_arch = "x86_64")]
vector_tile!(
    avx2_f32, "avx2,fma", f32, __m256, 8, 6: 1 2 3 4 5 6,
    _mm256_setzero_ps, _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_mul_ps, _mm256_fmadd_ps,
    (|count: usize| _mm256_loadu_si256(super::WINDOW[8 - count..].as_ptr().cast())), _mm256_maskload_ps(mask_last), _mm256_maskstore_ps
);
#[cfg(target_arch = "x86_64")]
vector_tile!(
    avx2_f64, "avx2,fma", f64, __m256d, 4, 6: 1 2 3 4 5 6,
    _mm256_setzero_pd, _mm256_set1_pd, _mm256_loadu_pd, _mm256_storeu_pd, _mm256_mul_pd, _mm256_fmadd_pd,
    (|count: usize| _mm256_loadu_si256(super::WINDOW[8 - 2 * count..].as_ptr().cast())), _mm256_maskload_pd(mask_last), _mm256_maskstore_pd
);

/// The same for any target: arrays that the compiler vectorises as far as the baseline goes.
macro_rules! portable_tile {
    ($name:ident, $t:ty, $lanes:literal) => {
        #[allow(unsafe_code)]
        pub mod $name {
            pub const LANES: usize = $lanes;
            type Vector = [$t; LANES];

            #[inline(always)]
            fn zero() -> Vector {
                [0.0; LANES]
            }
            #[inline(always)]
            fn splat(x: $t) -> Vector {
                [x; LANES]
            }
            #[inline(always)]
            fn mul(a: Vector, b: Vector) -> Vector {
                std::array::from_fn(|i| a[i] * b[i])
            }
            // A fused operation would be a library call here.
            #[inline(always)]
            fn mul_add(a: Vector, b: Vector, c: Vector) -> Vector {
                std::array::from_fn(|i| a[i] * b[i] + c[i])
            }
            #[inline(always)]
            unsafe fn load(p: *const $t) -> Vector {
                // SAFETY: the caller vouches for LANES elements; Vector has no more alignment than they.
                unsafe { p.cast::<Vector>().read() }
            }
            #[inline(always)]
            unsafe fn store(p: *mut $t, x: Vector) {
                // SAFETY: as for `load`.
                unsafe { p.cast::<Vector>().write(x) }
            }
            #[inline(always)]
            unsafe fn load_part(p: *const $t, count: usize) -> Vector {
                // SAFETY: the caller vouches for `count` elements.
                std::array::from_fn(|i| if i < count { unsafe { *p.add(i) } } else { 0.0 })
            }
            #[inline(always)]
            unsafe fn store_part(p: *mut $t, count: usize, x: Vector) {
                for i in 0..count {
                    // SAFETY: the caller vouches for `count` elements.
                    unsafe { *p.add(i) = x[i] }
                }
            }

            tile!($t, 4: 1 2 3 4,);
        }
    };
}

portable_tile!(portable_f32, f32, 4);
portable_tile!(portable_f64, f64, 2);

/// `len` elements of a buffer that only grows, from a cache line's start.
fn aligned<T: Copy>(buffer: &mut Vec<T>, len: usize, zero: T) -> &mut [T] {
    let line = 64 / size_of::<T>();
    if buffer.len() < len + line {
        buffer.resize((len + line).next_power_of_two(), zero);
    }
    let skip = buffer.as_ptr().align_offset(64).min(line);
    &mut buffer[skip..skip + len]
}

macro_rules! scalar {
    ($t:ty, $avx512:ident, $avx2:ident, $portable:ident) => {
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

scalar!(f32, avx512_f32, avx2_f32, portable_f32);
scalar!(f64, avx512_f64, avx2_f64, portable_f64);
