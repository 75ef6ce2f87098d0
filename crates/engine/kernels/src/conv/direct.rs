//! Convolutions of stride 1, without a matrix of windows.
//!
//! A band of padded input rows is copied to a buffer that stays in the cache. The values of one window element at
//! neighboring pixels are then contiguous in a row of that band, where the register tiles of [`gemm`](crate::gemm) read
//! them.

use super::windows::{Windows, slide};
use crate::gemm::pack;
use crate::gemm::tile::{LeftOperand, OutputRows, RUNS};
use crate::parallel::{Interleaved, for_chunks, for_ranges};
use crate::target::put;
use crate::{Real, simd};
use std::ops::Range;

/// Elements of a band of rows; a band stays in the second-level cache.
const BAND: usize = 1 << 16;
/// Window elements, or pixels, that are summed before the sum is added to the result.
const CHAIN: usize = 512;
/// Tasks per thread.
const TASKS: usize = 4;

/// True if windows of neighboring pixels are shifted by one element, and have more than one element.
pub(super) fn suits<T>(x: &Windows<'_, T>) -> bool {
    x.stride == 1 && x.kh * x.kw > 1 && x.c > 0 && x.out_w > 0
}

/// The layout of a band of padded rows in memory: channel by channel.
#[derive(Clone, Copy)]
struct Layout {
    /// Distance between rows, in elements.
    row: usize,
    /// Distance between channels, in elements.
    plane: usize,
}

impl Layout {
    fn new<T>(x: &Windows<'_, T>, rows: usize) -> Self {
        let row = x.out_w + x.kw - 1;
        // An odd number of cache lines, so that channels do not fall into the same sets of the caches.
        Self { row, plane: (((rows + x.kh - 1) * row).div_ceil(16) * 16) | 16 }
    }

    /// The position of window element `k` of the first pixel.
    fn offset<T>(self, x: &Windows<'_, T>, k: usize) -> usize {
        let taps = x.kh * x.kw;
        k / taps * self.plane + k % taps / x.kw * self.row + k % x.kw
    }
}

impl<T: Real> Windows<'_, T> {
    /// Copies the input rows that output rows `rows` depend on, of `channels`, with the zeros around the image.
    fn copy_band(&self, entry: usize, channels: Range<usize>, rows: Range<usize>, layout: Layout, band: &mut [T]) {
        let image = &self.x[entry * self.c * self.h * self.w..][..self.c * self.h * self.w];
        simd::dispatch(
            #[inline(always)]
            || {
                for (c, plane) in channels.zip(band.chunks_exact_mut(layout.plane)) {
                    for (r, out) in plane.chunks_exact_mut(layout.row).take(rows.len() + self.kh - 1).enumerate() {
                        let y = (rows.start + r) as isize - self.pads[0];
                        if y < 0 || y as usize >= self.h {
                            out.fill(T::ZERO);
                        } else {
                            let line = &image[(c * self.h + y as usize) * self.w..][..self.w];
                            slide(line, -self.pads[1], 1, out);
                        }
                    }
                }
            },
        );
    }

    fn depth(&self) -> usize {
        self.c * self.kh * self.kw
    }
}

/// Computes y = w * x + beta y for `n` images; `w` is `[o, depth]`, `y` `[n, o, out_h, out_w]`.
pub(super) fn forward<T: Real>(x: &Windows<'_, T>, [n, o, out_h]: [usize; 3], w: &[T], y: &mut [T], beta: T) {
    let (depth, width) = (x.depth(), x.out_w);
    let pixels = out_h * width;
    let level = simd::level();
    let (tile_rows, tile_cols) = T::tile(level);
    assert!(w.len() == o * depth && y.len() == n * o * pixels, "conv2d: lengths");
    let even = (n * out_h).div_ceil(TASKS * rayon::current_num_threads()).max(1);
    let rows = (BAND / Layout::new(x, 1).row / x.c.max(1)).saturating_sub(x.kh - 1).clamp(1, even.min(out_h.max(1)));
    let bands = out_h.div_ceil(rows);
    let layout = Layout::new(x, rows);
    let tiles = o.div_ceil(tile_rows);
    let tile = |t: usize| o * t / tiles..o * (t + 1) / tiles;
    let y = Interleaved::new(y);
    for_ranges(n * bands, 1, |task| {
        let (entry, band) = (task.start / bands, task.start % bands);
        let rows = band * rows..out_h.min((band + 1) * rows);
        // The last tile of a row may read beyond the row, but does not use the surplus.
        T::with_panel(x.c * layout.plane + tile_cols, |room| {
            x.copy_band(entry, 0..x.c, rows.clone(), layout, room);
            let mut offsets = [0; CHAIN];
            for k in (0..depth).step_by(CHAIN) {
                let offsets = &mut offsets[..CHAIN.min(depth - k)];
                offsets.iter_mut().enumerate().for_each(|(i, offset)| *offset = layout.offset(x, k + i));
                let beta = if k == 0 { beta } else { T::ONE };
                let furthest = offsets.last().map_or(0, |last| *last);
                for i in rows.clone() {
                    for j in (0..width).step_by(tile_cols) {
                        let cols = tile_cols.min(width - j);
                        let from = (i - rows.start) * layout.row + j;
                        let read = from + furthest + T::panel_width(level, cols);
                        debug_assert!(read <= room.len(), "conv2d reads its band beyond the end");
                        for outputs in (0..tiles).map(tile) {
                            let a = outputs.start * depth + k;
                            let at = (entry * o + outputs.start) * pixels + i * width + j;
                            debug_assert!(a + (outputs.len() - 1) * depth + offsets.len() <= w.len());
                            debug_assert!(at + (outputs.len() - 1) * pixels + cols <= y.len());
                            // SAFETY: all elements lie inside the slices, which is asserted in debug builds, and each
                            // row of the output belongs to one task.
                            #[allow(unsafe_code)]
                            unsafe {
                                let a = LeftOperand { start: w.as_ptr().add(a), strides: [depth, 1] };
                                let y = OutputRows { start: y.pointer(at), stride: pixels };
                                let (size, b) = ([outputs.len(), cols], room.as_ptr().add(from));
                                T::multiply_shifted(level, size, a, b, offsets, beta, y);
                            }
                        }
                    }
                }
            }
        });
    });
}

/// Length of the scratch space of [`weights`].
pub(super) fn weights_scratch_len<T: Real>(x: &Windows<'_, T>, o: usize, out_h: usize) -> usize {
    let (_, tile_cols) = T::tile(simd::level());
    o.next_multiple_of(tile_cols) * (x.depth() + out_h * x.out_w)
}

/// Adds the sum over images and pixels of dy times the window at that pixel to beta dw: `dy` is `[n, o, out_h, out_w]`,
/// `dw` `[o, depth]`.
pub(super) fn weights<T: Real>(
    x: &Windows<'_, T>,
    [n, o, out_h]: [usize; 3],
    dy: &[T],
    dw: &mut [T],
    beta: T,
    scratch: &mut [T],
) {
    let (depth, width) = (x.depth(), x.out_w);
    let pixels = out_h * width;
    let level = simd::level();
    let (tile_rows, tile_cols) = T::tile(level);
    let panels = o.div_ceil(tile_cols);
    // The transposed result, and the gradients of one image pixel by pixel, both in panels of output channels.
    let (sums, turned) = scratch[..weights_scratch_len(x, o, out_h)].split_at_mut(panels * tile_cols * depth);
    let outputs = |panel: usize| panel * tile_cols..o.min((panel + 1) * tile_cols);
    // The pixels that are summed at a time: several rows, or a part of one.
    let run = width.div_ceil(width.div_ceil(CHAIN));
    let rows = if run < width { 1 } else { (CHAIN / width).clamp(1, out_h.max(1)) };
    let layout = Layout::new(x, rows);
    let taps = x.kh * x.kw;
    let group = RUNS.min(tile_rows);
    // Each task takes some window elements, in whole groups.
    let share = depth.div_ceil(TASKS * rayon::current_num_threads()).next_multiple_of(group);
    for entry in 0..n {
        let dy = &dy[entry * o * pixels..][..o * pixels];
        let turn = Interleaved::new(&mut *turned);
        let blocks = pixels.div_ceil(CHAIN);
        for_ranges(panels * blocks, 1, |task| {
            let (panel, block) = (task.start / blocks, task.start % blocks);
            let (pixel, outputs) = (block * CHAIN, outputs(panel));
            let count = CHAIN.min(pixels - pixel);
            let padded = T::panel_width(level, outputs.len());
            // SAFETY: a block of a panel belongs to one task.
            #[allow(unsafe_code)]
            let to = unsafe { turn.slice(panel * tile_cols * pixels + pixel * padded, count * padded) };
            pack(&dy[outputs.start * pixels + pixel..], [1, pixels], count, outputs.len(), padded, to);
        });
        let sums = Interleaved::new(&mut *sums);
        for_ranges(depth.div_ceil(share), 1, |task| {
            let elements = task.start * share..depth.min((task.start + 1) * share);
            let channels = elements.start / taps..(elements.end - 1) / taps + 1;
            T::with_panel(channels.len() * layout.plane, |band| {
                for i in (0..out_h).step_by(rows) {
                    let rows = i..out_h.min(i + rows);
                    x.copy_band(entry, channels.clone(), rows.clone(), layout, band);
                    for j in (0..width).step_by(run) {
                        let run = run.min(width - j);
                        let beta = if (entry, i, j) == (0, 0, 0) { T::ZERO } else { T::ONE };
                        for panel in 0..panels {
                            let cols = outputs(panel).len();
                            let padded = T::panel_width(level, cols);
                            let from = panel * tile_cols * pixels + (i * width + j) * padded;
                            debug_assert!(from + ((rows.len() - 1) * width + run) * padded <= turned.len());
                            for k in elements.clone().step_by(group) {
                                let mut offsets = [0; RUNS];
                                let offsets = &mut offsets[..group.min(elements.end - k)];
                                for (e, offset) in offsets.iter_mut().enumerate() {
                                    *offset = layout.offset(x, k + e - channels.start * taps) + j;
                                    debug_assert!(*offset + (rows.len() - 1) * layout.row + run <= band.len());
                                }
                                let at = panel * tile_cols * depth + k * padded;
                                debug_assert!(at + (offsets.len() - 1) * padded + cols <= sums.len());
                                // SAFETY: all elements lie inside the slices, which is asserted in debug builds, and
                                // each window element belongs to one task.
                                #[allow(unsafe_code)]
                                unsafe {
                                    let size = [cols, run, rows.len(), layout.row];
                                    let panel = turned.as_ptr().add(from);
                                    let sums = OutputRows { start: sums.pointer(at), stride: padded };
                                    T::multiply_runs(level, size, band.as_ptr(), offsets, panel, beta, sums);
                                }
                            }
                        }
                    }
                }
            });
        });
    }
    for_chunks(dw, depth.max(1), |output, dw| {
        let (panel, column) = (output / tile_cols, output % tile_cols);
        let padded = T::panel_width(level, outputs(panel).len());
        let sums = &sums[panel * tile_cols * depth..];
        for (k, dw) in dw.iter_mut().enumerate() {
            put(dw, beta, if n * pixels == 0 { T::ZERO } else { sums[k * padded + column] });
        }
    });
}
