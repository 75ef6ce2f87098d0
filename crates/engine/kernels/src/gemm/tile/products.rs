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

#[cfg(target_arch = "aarch64")]
mod neon;
mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

#[cfg(target_arch = "aarch64")]
pub use neon::*;
pub use portable::*;
#[cfg(target_arch = "x86_64")]
pub use x86::*;
