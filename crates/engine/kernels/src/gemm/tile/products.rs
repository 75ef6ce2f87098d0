//! The inner loops of the tile, for each instruction set.

use super::{LeftOperand, OutputRows};

/// C = alpha sums + beta C for a tile of `$cols` columns. A function that is not inlined would keep sums in memory.
macro_rules! write_tile {
    ($sums:ident: $m:ident x $v:ident, $cols:expr, $alpha:expr, $beta:expr, $c:ident) => {
        let plain = $alpha == 1.0 && $beta == 0.0 && $cols == $v * LANES;
        for i in 0..$m {
            for v in 0..$v {
                let c = $c.start.add(i * $c.stride + v * LANES);
                if plain {
                    store(c, $sums[i][v]);
                } else {
                    finish($sums[i][v], $cols - v * LANES, $alpha, $beta, c);
                }
            }
        }
    };
}

/// Defines `multiply` for one vector type in terms of the names in scope: `LANES`, `zero`, `splat`, `load`, `store`,
/// `mul_add`, `fetch`, `finish`; a tile is `$rows` high, two vectors wide. `$turn` steps of the depth make one turn of
/// the loop where rows of A are contiguous; they share what the loop itself costs.
macro_rules! products {
    ($t:ty, $turn:literal, $rows:literal: $($row:literal)*, $(#[$feature:meta])*) => {
        pub const ROWS: usize = $rows;
        const TURN: usize = $turn;

        $(#[$feature])*
        pub unsafe fn multiply(
            size: [usize; 3], alpha: $t, a: LeftOperand<$t>, panel: *const $t, beta: $t, c: OutputRows<$t>,
        ) {
            let [rows, cols, depth] = size;
            // SAFETY: passed on from the caller.
            unsafe {
                match (rows, cols <= LANES, a.strides[1] == 1) {
                    $(
                        ($row, true, true) => tile::<$row, 1, { TURN > 1 }>(cols, depth, alpha, a, panel, beta, c),
                        ($row, true, false) => tile::<$row, 1, false>(cols, depth, alpha, a, panel, beta, c),
                        ($row, false, true) => tile::<$row, 2, { TURN > 1 }>(cols, depth, alpha, a, panel, beta, c),
                        ($row, false, false) => tile::<$row, 2, false>(cols, depth, alpha, a, panel, beta, c),
                    )*
                    _ => unreachable!("a tile has 1 to {ROWS} rows"),
                }
            }
        }

        /// A tile of M rows and V vectors. `CONTIGUOUS` is true if the elements of a row of A are neighbors.
        $(#[$feature])*
        unsafe fn tile<const M: usize, const V: usize, const CONTIGUOUS: bool>(
            cols: usize, depth: usize, alpha: $t, a: LeftOperand<$t>, panel: *const $t, beta: $t, c: OutputRows<$t>,
        ) {
            let LeftOperand { start: a, strides } = a;
            let mut sums = [[zero(); V]; M];
            // SAFETY: all offsets lie inside the memory that the caller guarantees.
            unsafe {
                fetch::<M, V>(cols, c);
                let together = if CONTIGUOUS { depth / TURN * TURN } else { 0 };
                if CONTIGUOUS {
                    // Every third row has a pointer; the factors of an address, 1 and 2, reach the rows between.
                    let (mut heads, mut b) = ([a, a.wrapping_add(3 * strides[0])], panel);
                    for _ in 0..depth / TURN {
                        for p in 0..TURN {
                            step(&mut sums, |i| heads[i / 3].add(i % 3 * strides[0] + p), b.add(p * V * LANES));
                        }
                        heads = heads.map(|head| head.wrapping_add(TURN));
                        b = b.add(TURN * V * LANES);
                    }
                }
                for p in together..depth {
                    step(&mut sums, |i| a.add(i * strides[0] + p * strides[1]), panel.add(p * V * LANES));
                }
                write_tile!(sums: M x V, cols, alpha, beta, c);
            }
        }

        /// Adds the product of a column of A, whose element i is at `a(i)`, and a row of B.
        $(#[$feature])*
        #[inline]
        unsafe fn step<const M: usize, const V: usize>(
            sums: &mut [[Vector; V]; M], a: impl Fn(usize) -> *const $t, b: *const $t,
        ) {
            let mut row = [zero(); V];
            // SAFETY: passed on from the caller.
            unsafe {
                for v in 0..V {
                    row[v] = load(b.add(v * LANES));
                }
                for i in 0..M {
                    let x = splat(*a(i));
                    for v in 0..V {
                        sums[i][v] = mul_add(x, row[v], sums[i][v]);
                    }
                }
            }
        }
    };
}

/// Defines `multiply_shifted` and `multiply_runs` for one vector type, in terms of the names that `products` needs.
macro_rules! windows {
    ($t:ty, $($row:literal)*, $(#[$feature:meta])*) => {
        $(#[$feature])*
        pub unsafe fn multiply_shifted(
            size: [usize; 2], a: LeftOperand<$t>, b: *const $t, offsets: &[usize], beta: $t, c: OutputRows<$t>,
        ) {
            let [rows, cols] = size;
            // SAFETY: passed on from the caller.
            unsafe {
                match (rows, cols <= LANES) {
                    $(
                        ($row, true) => shifted::<$row, 1>(cols, a, b, offsets, beta, c),
                        ($row, false) => shifted::<$row, 2>(cols, a, b, offsets, beta, c),
                    )*
                    _ => unreachable!("a tile has 1 to {ROWS} rows"),
                }
            }
        }

        $(#[$feature])*
        unsafe fn shifted<const M: usize, const V: usize>(
            cols: usize, a: LeftOperand<$t>, b: *const $t, offsets: &[usize], beta: $t, c: OutputRows<$t>,
        ) {
            let LeftOperand { start: a, strides } = a;
            let mut sums = [[zero(); V]; M];
            // SAFETY: all offsets lie inside the memory that the caller guarantees.
            unsafe {
                fetch::<M, V>(cols, c);
                for (p, offset) in offsets.iter().enumerate() {
                    step(&mut sums, |i| a.add(i * strides[0] + p * strides[1]), b.add(*offset));
                }
                write_tile!(sums: M x V, cols, 1.0, beta, c);
            }
        }

        $(#[$feature])*
        pub unsafe fn multiply_runs(
            size: [usize; 4], a: *const $t, offsets: &[usize], panel: *const $t, beta: $t, c: OutputRows<$t>,
        ) {
            // SAFETY: passed on from the caller.
            unsafe {
                match (offsets.len(), size[0] <= LANES) {
                    $(
                        ($row, true) => runs::<$row, 1>(size, a, offsets, panel, beta, c),
                        ($row, false) => runs::<$row, 2>(size, a, offsets, panel, beta, c),
                    )*
                    _ => unreachable!("a tile has 1 to {ROWS} rows"),
                }
            }
        }

        $(#[$feature])*
        unsafe fn runs<const M: usize, const V: usize>(
            size: [usize; 4], a: *const $t, offsets: &[usize], mut panel: *const $t, beta: $t, c: OutputRows<$t>,
        ) {
            let [cols, depth, count, apart] = size;
            let mut sums = [[zero(); V]; M];
            // SAFETY: all offsets lie inside the memory that the caller guarantees.
            unsafe {
                fetch::<M, V>(cols, c);
                for run in 0..count {
                    let mut rows = [a; M];
                    for (row, offset) in rows.iter_mut().zip(offsets) {
                        *row = a.add(offset + run * apart);
                    }
                    for p in 0..depth {
                        step(&mut sums, |i| rows[i].add(p), panel);
                        panel = panel.add(V * LANES);
                    }
                }
                write_tile!(sums: M x V, cols, 1.0, beta, c);
            }
        }
    };
}

/// Defines `fetch` and `finish` for one vector type, in terms of `load_part`, `store_part` and `mul` as well.
macro_rules! stores {
    ($t:ty, $(#[$feature:meta])*) => {
        /// Prefetches C, which is needed only after the loop over the depth.
        $(#[$feature])*
        #[inline]
        pub(super) fn fetch<const M: usize, const V: usize>(cols: usize, c: OutputRows<$t>) {
            const LINE: usize = 64 / size_of::<$t>();
            // Rows that do not begin with a cache line reach into one more.
            let ragged = !c.start.addr().is_multiple_of(64) || !c.stride.is_multiple_of(LINE);
            for i in 0..M {
                let row = c.start.wrapping_add(i * c.stride);
                for at in (0..V * LANES).step_by(LINE) {
                    crate::simd::prefetch(row.wrapping_add(at));
                }
                if ragged {
                    crate::simd::prefetch(row.wrapping_add(cols - 1));
                }
            }
        }

        /// C = alpha sum + beta C for `cols` elements of one vector, or all of it.
        $(#[$feature])*
        #[inline]
        pub(super) unsafe fn finish(sum: Vector, cols: usize, alpha: $t, beta: $t, c: *mut $t) {
            let (scale, mut sum) = (splat(beta), mul(splat(alpha), sum));
            // SAFETY: the caller guarantees the elements.
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
        $name:ident, $features:literal, $t:ty, $v:ty, $lanes:literal, $turn:literal, $rows:literal: $($row:literal)*,
        $zero:ident, $splat:ident, $load:ident, $store:ident, $mul:ident, $mul_add:ident,
        $mask:expr, $load_part:ident($($load_arg:ident)*), $store_part:ident
    ) => {
        #[allow(unsafe_code)]
        pub mod $name {
            use super::{LeftOperand, OutputRows};
            use std::arch::x86_64::*;

            pub const LANES: usize = $lanes;
            pub(super) type Vector = $v;

            #[inline]
            #[target_feature(enable = $features)]
            pub(super) fn zero() -> $v {
                $zero()
            }
            #[inline]
            #[target_feature(enable = $features)]
            pub(super) fn splat(x: $t) -> $v {
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
            pub(super) unsafe fn load(p: *const $t) -> $v {
                // SAFETY: the caller guarantees LANES elements.
                unsafe { $load(p) }
            }
            #[inline]
            #[target_feature(enable = $features)]
            pub(super) unsafe fn store(p: *mut $t, x: $v) {
                // SAFETY: the caller guarantees LANES elements.
                unsafe { $store(p, x) }
            }
            #[inline]
            #[target_feature(enable = $features)]
            unsafe fn load_part(p: *const $t, count: usize) -> $v {
                // SAFETY: masked lanes are not accessed; the caller guarantees `count` elements.
                unsafe {
                    let mask = $mask(count);
                    vector_tile!(@load $load_part, mask, p, $($load_arg)*)
                }
            }
            #[inline]
            #[target_feature(enable = $features)]
            unsafe fn store_part(p: *mut $t, count: usize, x: $v) {
                // SAFETY: masked lanes are not accessed; the caller guarantees `count` elements.
                unsafe { $store_part(p, $mask(count), x) }
            }

            products!($t, $turn, $rows: $($row)*, #[target_feature(enable = $features)]);
            windows!($t, $($row)*, #[target_feature(enable = $features)]);
            stores!($t, #[target_feature(enable = $features)]);
        }
    };
    (@load $load:ident, $mask:ident, $p:ident, mask_first) => { $load($mask, $p) };
    (@load $load:ident, $mask:ident, $p:ident, mask_last) => { $load($p, $mask) };
}

/// Eight set lanes followed by eight clear ones: a window of it is a mask of the first `count` lanes.
#[cfg(target_arch = "x86_64")]
static WINDOW: [i32; 16] = [-1, -1, -1, -1, -1, -1, -1, -1, 0, 0, 0, 0, 0, 0, 0, 0];

#[cfg(target_arch = "x86_64")]
vector_tile!(
    avx512_f32, "avx512f", f32, __m512, 16, 1, 12: 1 2 3 4 5 6 7 8 9 10 11 12,
    _mm512_setzero_ps, _mm512_set1_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_mul_ps, _mm512_fmadd_ps,
    (|count: usize| ((1_u32 << count) - 1) as __mmask16), _mm512_maskz_loadu_ps(mask_first), _mm512_mask_storeu_ps
);
#[cfg(target_arch = "x86_64")]
vector_tile!(
    avx512_f64, "avx512f", f64, __m512d, 8, 1, 12: 1 2 3 4 5 6 7 8 9 10 11 12,
    _mm512_setzero_pd, _mm512_set1_pd, _mm512_loadu_pd, _mm512_storeu_pd, _mm512_mul_pd, _mm512_fmadd_pd,
    (|count: usize| ((1_u32 << count) - 1) as __mmask8), _mm512_maskz_loadu_pd(mask_first), _mm512_mask_storeu_pd
);
#[cfg(target_arch = "x86_64")]
vector_tile!(
    avx2_f32, "avx2,fma", f32, __m256, 8, 4, 6: 1 2 3 4 5 6,
    _mm256_setzero_ps, _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_mul_ps, _mm256_fmadd_ps,
    (|count: usize| _mm256_loadu_si256(super::WINDOW[8 - count..].as_ptr().cast())), _mm256_maskload_ps(mask_last), _mm256_maskstore_ps
);
#[cfg(target_arch = "x86_64")]
vector_tile!(
    avx2_f64, "avx2,fma", f64, __m256d, 4, 4, 6: 1 2 3 4 5 6,
    _mm256_setzero_pd, _mm256_set1_pd, _mm256_loadu_pd, _mm256_storeu_pd, _mm256_mul_pd, _mm256_fmadd_pd,
    (|count: usize| _mm256_loadu_si256(super::WINDOW[8 - 2 * count..].as_ptr().cast())), _mm256_maskload_pd(mask_last), _mm256_maskstore_pd
);

/// Tiles whose numbers are pairs of bf16: a product is the sum of two products.
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
pub mod avx512_pairs {
    use super::avx512_f32::{LANES, Vector, fetch, finish, load, splat, store, zero};
    use super::{LeftOperand, OutputRows};
    use std::arch::x86_64::*;

    #[inline]
    #[target_feature(enable = "avx512f,avx512bf16")]
    fn mul_add(a: Vector, b: Vector, sum: Vector) -> Vector {
        // SAFETY: any bits are a vector of either type.
        let [a, b] = unsafe { std::mem::transmute::<[__m512; 2], [__m512bh; 2]>([a, b]) };
        _mm512_dpbf16_ps(sum, a, b)
    }

    products!(f32, 1, 12: 1 2 3 4 5 6 7 8 9 10 11 12, #[target_feature(enable = "avx512f,avx512bf16")]);
}

/// The vector functions and the tile for any target: arrays, which the compiler vectorizes with the baseline
/// instructions.
macro_rules! portable_tile {
    ($name:ident, $t:ty, $lanes:literal) => {
        #[allow(unsafe_code)]
        pub mod $name {
            use super::{LeftOperand, OutputRows};

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
                // SAFETY: the caller guarantees LANES elements; Vector needs no more alignment than they have.
                unsafe { p.cast::<Vector>().read() }
            }
            #[inline(always)]
            unsafe fn store(p: *mut $t, x: Vector) {
                // SAFETY: as for `load`.
                unsafe { p.cast::<Vector>().write(x) }
            }
            #[inline(always)]
            unsafe fn load_part(p: *const $t, count: usize) -> Vector {
                // SAFETY: the caller guarantees `count` elements.
                std::array::from_fn(|i| if i < count { unsafe { *p.add(i) } } else { 0.0 })
            }
            #[inline(always)]
            unsafe fn store_part(p: *mut $t, count: usize, x: Vector) {
                for i in 0..count {
                    // SAFETY: the caller guarantees `count` elements.
                    unsafe { *p.add(i) = x[i] }
                }
            }

            products!($t, 1, 4: 1 2 3 4,);
            windows!($t, 1 2 3 4,);
            stores!($t,);
        }
    };
}

portable_tile!(portable_f32, f32, 4);
portable_tile!(portable_f64, f64, 2);
