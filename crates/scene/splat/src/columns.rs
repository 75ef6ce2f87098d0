//! Rows of numbers in memory as columns of sixteen, and back.

use crate::each::each;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, Lanes};
use weaver_kernels::simd::prefetch;

/// Mask of the numbers that are neither infinite nor NaN.
#[inline(always)]
pub(crate) fn finite<V: Lanes>(x: V) -> V::Mask {
    (x * V::zero()).ge(V::zero())
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

/// Writes `columns` as rows of `K` numbers, or adds them; 0 for numbers that are not finite.
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

/// Prefetches numbers: rows are read out of order, which the processor does not foresee.
#[inline(always)]
pub(crate) fn prefetch_rows<T>(values: &[T], from: usize, count: usize) {
    let values = &values[from.min(values.len())..(from + count).min(values.len())];
    values.iter().step_by(64 / size_of::<T>()).for_each(|x| prefetch(x));
}

/// Rows of `len` numbers as columns, 16 at a time in registers: column k goes to `out[k]`, up to the next multiple
/// of 16. Lanes beyond the rows are zero.
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

/// The inverse of [`wide_columns`]: writes columns as rows, or adds them; 0 for numbers that are not finite.
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
