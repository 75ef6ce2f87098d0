//! A Gaussian as one view sees it: the sixteen numbers that blending needs, one cache line in `f32`.
//!
//! The inverse of the image covariance S has the Cholesky factor L = [[p, q], [0, r]]: with d = (dx, dy) from the center
//! to a pixel, u = p dx + q dy and v = r dy make d^T S^-1 d = u^2 + v^2, a sum of squares that never turns negative. p, q, r
//! are stored times [`BITS`], so that the Gaussian is opacity times 2^-(u^2 + v^2).

use crate::each::each;
use crate::project::finite;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, Lanes, Row};
use weaver_kernels::simd::prefetch;

/// sqrt(log2(e) / 2): exp(-x^2 / 2) = 2^-(BITS x)^2.
pub(crate) const BITS: f64 = 0.849_321_800_288_019_2;

/// The numbers of a splat, in the order of [`slot`].
pub(crate) type Splat<T> = Row<T>;

/// Where a [`Splat`] keeps what.
pub(crate) mod slot {
    /// Center, pixels.
    pub const X: usize = 0;
    pub const Y: usize = 1;
    /// u = p dx + q dy
    pub const P: usize = 2;
    pub const Q: usize = 3;
    /// v = r dy
    pub const R: usize = 4;
    /// Opacity, compensated when antialiased.
    pub const OPACITY: usize = 5;
    /// Pixels that rounding may move the outline by.
    pub const SLACK: usize = 6;
    /// Camera z.
    pub const Z: usize = 7;
    /// Color toward the camera: red, green, blue.
    pub const COLOR: usize = 8;
    /// Largest |dy| inside the outline, with slack.
    pub const HALF_HEIGHT: usize = 11;
    /// dy where the outline's dx is largest; dx is smallest at its negative.
    pub const DY_OF_RIGHT: usize = 12;
    /// u^2 + v^2 on the outline, where alpha falls below what is visible (rounded up).
    pub const REACH: usize = 13;
    /// 1 / p
    pub const WIDTH: usize = 14;
    /// q / p
    pub const TILT: usize = 15;
}

/// The outlines of sixteen splats: where alpha reaches the visible minimum.
#[derive(Clone, Copy)]
pub(crate) struct Outline<V> {
    pub x: V,
    pub y: V,
    pub r: V,
    pub slack: V,
    pub half_height: V,
    pub dy_of_right: V,
    pub reach: V,
    pub width: V,
    pub tilt: V,
}

impl<V: Lanes> Outline<V> {
    /// From splats turned into columns.
    #[inline(always)]
    pub fn of_columns(columns: &[V; LANES]) -> Self {
        Self {
            x: columns[slot::X],
            y: columns[slot::Y],
            r: columns[slot::R],
            slack: columns[slot::SLACK],
            half_height: columns[slot::HALF_HEIGHT],
            dy_of_right: columns[slot::DY_OF_RIGHT],
            reach: columns[slot::REACH],
            width: columns[slot::WIDTH],
            tilt: columns[slot::TILT],
        }
    }

    /// Smallest and largest x between two rows of pixel centers, rounded outward, where there are any.
    #[inline(always)]
    pub fn span(&self, top: V, bottom: V) -> (V, V, V::Mask) {
        let low = (top - self.y - self.slack).max(-self.half_height);
        let high = (bottom - self.y + self.slack).min(self.half_height);
        let half_width = |dy: V| {
            let v = self.r * dy;
            v.neg_mul_add(v, self.reach).max(V::zero()).sqrt() * self.width
        };
        let at_right = self.dy_of_right.max(low).min(high);
        let at_left = (-self.dy_of_right).max(low).min(high);
        let right = self.x + self.slack + self.tilt.neg_mul_add(at_right, half_width(at_right));
        let left = self.x - self.slack - self.tilt.mul_add(at_left, half_width(at_left));
        (left, right, high.ge(low))
    }
}

/// Rows `first..first + count` of `K` numbers as columns; lanes beyond repeat the last row.
#[inline(always)]
pub(crate) fn columns<V: Lanes, const K: usize>(values: &[V::Scalar], first: usize, count: usize) -> [V; K] {
    let rows = &values[K * first..K * (first + count)].as_chunks::<K>().0;
    if let Some(rows) = rows.first_chunk::<LANES>() {
        return each!(K, |k| V::load(&each!(LANES, |lane| rows[lane][k])));
    }
    each!(K, |k| V::load(&each!(LANES, |lane| rows[lane.min(count - 1)][k])))
}

/// Writes `columns` as rows of `K` numbers, or adds them; 0 for what is not finite.
#[inline(always)]
pub(crate) fn put_columns<V: Lanes, const K: usize>(columns: &[V; K], add: bool, rows: &mut [V::Scalar]) {
    let columns = each!(K, |k| columns[k].only(finite(columns[k])).to_array());
    for (lane, row) in rows.as_chunks_mut::<K>().0.iter_mut().enumerate() {
        for k in 0..K {
            let old = if add { row[k] } else { V::Scalar::ZERO };
            row[k] = old + columns[k][lane];
        }
    }
}

/// Asks for numbers that will be needed soon: rows are read out of order, which the processor does not foresee.
#[inline(always)]
pub(crate) fn prefetch_rows<T>(values: &[T], from: usize, count: usize) {
    let values = &values[from.min(values.len())..(from + count).min(values.len())];
    values.iter().step_by(64 / size_of::<T>()).for_each(|x| prefetch(x));
}

/// Rows of `len` numbers as columns, 16 at a time in registers: column k goes to `out[k]`, up to the next multiple of
/// 16. Lanes beyond the rows are zero.
#[inline(always)]
pub(crate) fn wide_columns<V: Lanes>(rows: &[V::Scalar], len: usize, out: &mut [V]) {
    for (block, out) in out.as_chunks_mut::<LANES>().0.iter_mut().enumerate().take(len.div_ceil(LANES)) {
        let from = block * LANES;
        for (lane, out) in out.iter_mut().enumerate() {
            let row = rows.get(lane * len + from..(lane + 1) * len).unwrap_or(&[]);
            *out = match row.first_chunk::<LANES>() {
                Some(row) => V::load(row),
                None => V::from_fn(|k| row.get(k).copied().unwrap_or(V::Scalar::ZERO)),
            };
        }
        V::transpose(out);
    }
}

/// The inverse of [`wide_columns`]: writes columns as rows, or adds them; 0 for what is not finite.
#[inline(always)]
pub(crate) fn put_wide_columns<V: Lanes>(columns: &mut [V], len: usize, add: bool, rows: &mut [V::Scalar]) {
    for (block, columns) in columns.as_chunks_mut::<LANES>().0.iter_mut().enumerate().take(len.div_ceil(LANES)) {
        let from = block * LANES;
        columns.iter_mut().for_each(|x| *x = x.only(finite(*x)));
        V::transpose(columns);
        for (lane, row) in rows.chunks_exact_mut(len).enumerate() {
            let row = &mut row[from..];
            if let Some(row) = row.first_chunk_mut::<LANES>() {
                let sum = if add { V::load(row) + columns[lane] } else { columns[lane] };
                sum.store(row);
            } else {
                let values = columns[lane].to_array();
                for (old, x) in row.iter_mut().zip(values) {
                    *old = if add { *old + x } else { x };
                }
            }
        }
    }
}
