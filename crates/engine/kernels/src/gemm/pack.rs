//! Packing: copies of A and B in the order in which a tile reads them.

use super::{Batch, Mat};
use crate::Real;
use crate::lanes::{self, LANES, LaneKernel, Lanes};
use crate::simd;
use std::ops::Range;

/// The right factor of a [`Product`](super::Product): a matrix in memory, or one that is generated while it is packed.
pub(crate) trait Panels<T>: Sync {
    /// Writes rows `k` and columns `cols` of matrix `entry` to `panel`, in rows of `padded` elements with zeros after
    /// the columns. `spare` is scratch space as long as the largest panel.
    fn pack(&self, entry: usize, k: Range<usize>, cols: Range<usize>, padded: usize, panel: &mut [T], spare: &mut [T]);
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
}

/// Number of rows ahead of the one being packed that are prefetched.
pub(super) const AHEAD: usize = 32;

/// `out[p * padded + q] = data[p * strides[0] + q * strides[1]]`, zeros from `q = width` on.
pub(crate) fn pack<T: Real>(data: &[T], strides: [usize; 2], depth: usize, width: usize, padded: usize, out: &mut [T]) {
    let [row_stride, col_stride] = strides;
    if col_stride == 1 {
        simd::dispatch(
            #[inline(always)]
            || {
                for p in 0..depth {
                    let (row, out) = (&data[p * row_stride..], &mut out[p * padded..]);
                    // The processor does not prefetch rows that are far apart in memory by itself.
                    for q in (0..width).step_by(LANES) {
                        simd::prefetch(data.as_ptr().wrapping_add((p + AHEAD) * row_stride + q));
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
    } else {
        transpose(data, row_stride, col_stride, depth, width, padded, out);
    }
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
        out.fill(T::ZERO);
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
        let rows = depth / LANES * LANES;
        // A single narrow block may write beyond its columns: the next row overwrites the excess.
        let alone = width < LANES && padded == width;
        let cols = if alone { width } else { width / LANES * LANES };
        for q in (0..cols).step_by(LANES) {
            for p in (0..rows).step_by(LANES) {
                let mut block = [V::zero(); LANES];
                for (i, column) in block.iter_mut().enumerate().take(cols - q) {
                    let from = (q + i) * col_stride + p;
                    *column = V::load(data[from..].first_chunk().expect("rows of sixteen"));
                }
                V::transpose(&mut block);
                for (i, row) in block.iter().enumerate() {
                    let to = &mut out[(p + i) * padded + q..];
                    match to.first_chunk_mut() {
                        Some(to) => row.store(to),
                        None => to.copy_from_slice(&row.to_array()[..to.len()]),
                    }
                }
            }
        }
        (rows, cols)
    }
}
