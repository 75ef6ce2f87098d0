//! Packing: what a tile reads, in the order in which it reads it.

use super::Mat;
use crate::Real;
use crate::lanes::{self, LANES, LaneKernel, Lanes};
use crate::simd;
use std::ops::Range;

/// Where [`Product`](super::Product) gets B from: a matrix in memory, or one that is made as it is packed.
pub(crate) trait Panels<T>: Sync {
    /// Writes rows `k`, columns `cols` of matrix `entry` to `panel`, rows of `padded` elements, zeros
    /// behind the columns. `spare` is as long as the largest panel and free to use.
    fn pack(&self, entry: usize, k: Range<usize>, cols: Range<usize>, padded: usize, panel: &mut [T], spare: &mut [T]);
}

/// Matrices that begin `stride` apart.
pub(super) struct Stack<'a, T> {
    pub mat: Mat<'a, T>,
    pub stride: usize,
}

impl<T: Real> Panels<T> for Stack<'_, T> {
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
        let Mat { data, row_stride, col_stride } = self.mat;
        let data = &data[entry * self.stride + k.start * row_stride + cols.start * col_stride..];
        pack(data, [row_stride, col_stride], depth, width, padded, panel);
    }
}

/// Rows that are asked for before they are packed.
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
                    // Rows far apart in memory are no stream that the processor foresees.
                    for q in (0..width).step_by(LANES) {
                        simd::prefetch(data.as_ptr().wrapping_add((p + AHEAD) * row_stride + q));
                    }
                    let whole = width / LANES * LANES;
                    let (from, to) = (row[..whole].as_chunks::<LANES>().0, out[..whole].as_chunks_mut::<LANES>().0);
                    to.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
                    if whole < width {
                        match (row[whole..].first_chunk::<LANES>(), out[whole..].first_chunk_mut::<LANES>()) {
                            // What is copied beyond the row's end, the next row overwrites.
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

/// [`transpose`] of contiguous columns, sixteen by sixteen in registers.
struct Transpose<'a, T> {
    data: &'a [T],
    col_stride: usize,
    depth: usize,
    width: usize,
    padded: usize,
    out: &'a mut [T],
}

impl<T: Real> LaneKernel<T> for Transpose<'_, T> {
    /// Rows and columns that were done.
    type Output = (usize, usize);

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> (usize, usize) {
        let Self { data, col_stride, depth, width, padded, out } = self;
        let rows = depth / LANES * LANES;
        // A single block of fewer columns may write beyond them: the next row comes after it and overwrites that.
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
