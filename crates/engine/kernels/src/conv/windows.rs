//! The matrix of windows of a map (im2col), `[c kh kw, out_h out_w]`, generated panel by panel.

use crate::Real;
use crate::gemm::{Panels, transpose};
use crate::simd;
use std::ops::Range;

/// Windows of the images `x` `[n, c, h, w]`; matrix `entry` belongs to image `entry`. `pads` are the rows of zeros
/// above and the columns of zeros to the left; if negative, that many rows or columns are skipped.
pub(super) struct Windows<'a, T> {
    pub x: &'a [T],
    pub c: usize,
    pub h: usize,
    pub w: usize,
    pub kh: usize,
    pub kw: usize,
    pub stride: usize,
    pub pads: [isize; 2],
    pub out_w: usize,
}

impl<T: Real> Windows<'_, T> {
    /// Writes rows `k` of the window matrix at output pixels `pixels` to `out`, `row` elements apart.
    #[inline(always)]
    fn write(&self, entry: usize, k: Range<usize>, pixels: Range<usize>, out: &mut [T], row: usize) {
        let taps = self.kh * self.kw;
        let image = &self.x[entry * self.c * self.h * self.w..][..self.c * self.h * self.w];
        // The outer loop runs over output rows, so that values depending on the row alone are computed once.
        let mut from = pixels.start;
        while from < pixels.end {
            let (i, j) = (from / self.out_w, from % self.out_w);
            let run = (self.out_w - j).min(pixels.end - from);
            let at = from - pixels.start;
            let (mut c, mut p, mut q) = (k.start / taps, k.start % taps / self.kw, k.start % self.kw);
            for out in out.chunks_exact_mut(row).take(k.len()) {
                let y = (i * self.stride + p) as isize - self.pads[0];
                let out = &mut out[at..at + run];
                if y < 0 || y as usize >= self.h {
                    out.fill(T::ZERO);
                } else {
                    let line = &image[(c * self.h + y as usize) * self.w..][..self.w];
                    let x = (j * self.stride + q) as isize - self.pads[1];
                    if q == 0 {
                        // Prefetch the lines of later channels: planes are often a power of two apart and then share
                        // the same sets of the caches.
                        let ahead = ((c + 4) * self.h + y as usize) * self.w + j * self.stride;
                        let lines = image.get(ahead..).unwrap_or(&[]).chunks(16).take(run.div_ceil(16) + 1);
                        lines.for_each(|line| simd::prefetch(&line[0]));
                    }
                    slide(line, x, self.stride, out);
                }
                q += 1;
                if q == self.kw {
                    (p, q) = (p + 1, 0);
                }
                if p == self.kh {
                    (c, p) = (c + 1, 0);
                }
            }
            from += run;
        }
    }
}

/// Writes `line[x + i stride]` to `out[i]`, or zero where that is outside the line.
#[inline(always)]
pub(super) fn slide<T: Real>(line: &[T], x: isize, stride: usize, out: &mut [T]) {
    let (n, end) = (out.len(), line.len() as isize);
    // The number of elements before the line, and the number that do not lie behind it.
    let before = if x < 0 { x.unsigned_abs().div_ceil(stride).min(n) } else { 0 };
    let inside = if x >= end { 0 } else { ((end - x) as usize).div_ceil(stride).min(n) };
    let inside = inside.max(before);
    if stride == 1 {
        let from = (x + before as isize) as usize;
        copy(&line[from.min(line.len())..][..inside - before], &mut out[before..inside]);
    } else {
        for (i, o) in out.iter_mut().enumerate().take(inside).skip(before) {
            *o = line[(x + (i * stride) as isize) as usize];
        }
    }
    // Rarely more than one element on each side.
    for o in &mut out[..before] {
        *o = T::ZERO;
    }
    for o in &mut out[inside..] {
        *o = T::ZERO;
    }
}

/// Copies whole vectors, which avoids the library call of a copy of unknown length.
#[inline(always)]
fn copy<T: Real>(from: &[T], to: &mut [T]) {
    if let (Some(last), Some(to_last)) = (from.last_chunk::<16>(), to.last_chunk_mut::<16>()) {
        // The last vector may overlap the one before; this avoids a loop over single elements.
        *to_last = *last;
        for (o, b) in to.as_chunks_mut::<16>().0.iter_mut().zip(from.as_chunks::<16>().0) {
            *o = *b;
        }
        return;
    }
    for (o, b) in to.iter_mut().zip(from) {
        *o = *b;
    }
}

/// The window matrix as the right factor: rows are window elements, columns are pixels.
impl<T: Real> Panels<T> for Windows<'_, T> {
    fn pack(
        &self,
        entry: usize,
        k: Range<usize>,
        cols: Range<usize>,
        padded: usize,
        panel: &mut [T],
        _spare: &mut [T],
    ) {
        if cols.len() < padded {
            panel.fill(T::ZERO);
        }
        simd::dispatch(
            #[inline(always)]
            || self.write(entry, k, cols, panel, padded),
        );
    }
}

/// The transposed window matrix as the right factor: rows are pixels, columns are window elements.
pub(super) struct WindowRows<'a, T>(pub Windows<'a, T>);

impl<T: Real> Panels<T> for WindowRows<'_, T> {
    fn pack(&self, entry: usize, k: Range<usize>, cols: Range<usize>, padded: usize, panel: &mut [T], spare: &mut [T]) {
        let (depth, width) = (k.len(), cols.len());
        if depth == 0 {
            return;
        }
        let spare = &mut spare[..width * depth];
        simd::dispatch(
            #[inline(always)]
            || self.0.write(entry, cols, k, spare, depth),
        );
        transpose(spare, 1, depth, depth, width, padded, panel);
    }
}
