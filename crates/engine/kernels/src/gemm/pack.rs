//! Packing: copies of A and B in the order in which a tile reads them.

use super::{Batch, Mat, ROW_PART};
use crate::Real;
use crate::lanes::{self, LANES, LaneKernel, Lanes};
use crate::simd;
use std::ops::Range;

/// The right factor of a [`Product`](super::Product): a matrix in memory, or one that is generated while it is packed.
pub(crate) trait Panels<T>: Sync {
    /// Writes rows `k` and columns `cols` of matrix `entry` to `panel`, in rows of `padded` elements with zeros after
    /// the columns. `spare` is scratch space as long as the largest panel.
    fn pack(&self, entry: usize, k: Range<usize>, cols: Range<usize>, padded: usize, panel: &mut [T], spare: &mut [T]);

    /// True if neighboring panels should be packed in turn, a few rows of each, because a row is contiguous in memory
    /// but far from the next one.
    fn in_turn(&self) -> bool {
        false
    }
}

impl<T: Real> Panels<T> for Batch<Mat<'_, T>> {
    fn pack(
        &self,
        entry: usize,
        k: Range<usize>,
        cols: Range<usize>,
        padded: usize,
        panel: &mut [T],
        _spare: &mut [T],
    ) {
        if k.is_empty() {
            return;
        }
        let (width, depth) = (cols.len(), k.len());
        let Mat { data, row_stride, col_stride, .. } = self.first;
        let data = &data[entry * self.stride + k.start * row_stride + cols.start * col_stride..];
        pack(data, [row_stride, col_stride], depth, width, padded, panel);
    }

    fn in_turn(&self) -> bool {
        self.first.col_stride == 1 && self.first.row_stride > ROW_PART / size_of::<T>()
    }
}

/// Elements of a panel ahead of those being packed that are prefetched.
const AHEAD: usize = 1024;

/// `out[p * padded + q] = data[p * strides[0] + q * strides[1]]`, zeros from `q = width` on.
pub(crate) fn pack<T: Real>(data: &[T], strides: [usize; 2], depth: usize, width: usize, padded: usize, out: &mut [T]) {
    let [row_stride, col_stride] = strides;
    if col_stride != 1 {
        return transpose(data, row_stride, col_stride, depth, width, padded, out);
    }
    let ahead = AHEAD.div_ceil(width.max(1)) * row_stride;
    simd::dispatch(
        #[inline(always)]
        || {
            for p in 0..depth {
                let (row, out) = (&data[p * row_stride..], &mut out[p * padded..]);
                // The processor does not prefetch rows that are far apart in memory by itself.
                for q in (0..width).step_by(LANES) {
                    simd::prefetch(row.as_ptr().wrapping_add(ahead + q));
                }
                let whole = width / LANES * LANES;
                let (from, to) = (row[..whole].as_chunks::<LANES>().0, out[..whole].as_chunks_mut::<LANES>().0);
                to.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
                if whole < width {
                    match (row[whole..].first_chunk::<LANES>(), out[whole..].first_chunk_mut::<LANES>()) {
                        // The next row overwrites the surplus beyond the end of this one.
                        (Some(from), Some(to)) if padded == width => *to = *from,
                        _ => out[whole..width].copy_from_slice(&row[whole..width]),
                    }
                }
                out[width..padded].fill(T::ZERO);
            }
        },
    );
}

/// `out[p * padded + q] = data[p * row_stride + q * col_stride]`, zeros from `q = width` on.
pub(crate) fn transpose<T: Real>(
    data: &[T],
    row_stride: usize,
    col_stride: usize,
    depth: usize,
    width: usize,
    padded: usize,
    out: &mut [T],
) {
    if width < padded {
        out[..depth * padded].chunks_exact_mut(padded).for_each(|row| row[width..].fill(T::ZERO));
    }
    let mut done = (0, 0);
    if row_stride == 1 {
        let transpose = Transpose { data, col_stride, depth, width, padded, out: &mut *out };
        done = lanes::run(transpose);
    }
    for q in 0..width {
        let from = if q < done.1 { done.0 } else { 0 };
        for p in from..depth {
            out[p * padded + q] = data[p * row_stride + q * col_stride];
        }
    }
}

/// [`transpose`] of contiguous columns, in blocks of sixteen by sixteen in registers.
struct Transpose<'a, T> {
    data: &'a [T],
    col_stride: usize,
    depth: usize,
    width: usize,
    padded: usize,
    out: &'a mut [T],
}

impl<T: Real> LaneKernel<T> for Transpose<'_, T> {
    /// The rows and columns that have been written.
    type Output = (usize, usize);

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> (usize, usize) {
        let Self { data, col_stride, depth, width, padded, out } = self;
        // The last block overlaps the one before where the size is no multiple of sixteen.
        let starts = |size: usize| (0..size).step_by(LANES).map(move |at| at.min(size - LANES));
        // A single narrow block may write beyond its columns: the next row overwrites the excess.
        let alone = width < LANES && padded == width;
        if depth < LANES || width < LANES && !alone {
            return (0, 0);
        }
        if alone {
            let rows = depth / LANES * LANES;
            for p in (0..rows).step_by(LANES) {
                block::<V>(data, col_stride, p, width, |i, row| {
                    let to = &mut out[(p + i) * padded..];
                    match to.first_chunk_mut() {
                        Some(to) => row.store(to),
                        None => to.copy_from_slice(&row.to_array()[..to.len()]),
                    }
                });
            }
            return (rows, width);
        }
        for q in starts(width) {
            for p in starts(depth) {
                block::<V>(&data[q * col_stride..], col_stride, p, LANES, |i, row| {
                    row.store(out[(p + i) * padded + q..].first_chunk_mut().expect("a row of sixteen"));
                });
            }
        }
        (depth, width)
    }
}

/// Calls `write` with the rows of the transpose of `cols` columns, which begin at element `p`.
#[inline(always)]
fn block<V: Lanes>(data: &[V::Scalar], col_stride: usize, p: usize, cols: usize, mut write: impl FnMut(usize, V)) {
    let mut block = [V::zero(); LANES];
    for (i, column) in block.iter_mut().enumerate().take(cols) {
        *column = V::load(data[i * col_stride + p..].first_chunk().expect("rows of sixteen"));
    }
    V::transpose(&mut block);
    for (i, row) in block.iter().enumerate() {
        write(i, *row);
    }
}
