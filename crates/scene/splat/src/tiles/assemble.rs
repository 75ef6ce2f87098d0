//! From the planes of windows to the rows of images.

use super::window::{BLOCK, Plane, SIDE};
use super::{Blending, Tiles};
use crate::rasterizer::Images;
use weaver_kernels::{Real, parallel};

/// Planes of all windows.
#[derive(Clone, Copy)]
pub(super) struct WindowPlanes<'a, T> {
    pub planes: &'a [Plane<T>],
    pub per_window: usize,
}

impl<'a, T> WindowPlanes<'a, T> {
    /// The planes of a window.
    fn of(&self, window: usize) -> &'a [Plane<T>] {
        &self.planes[window * self.per_window..][..self.per_window]
    }
}

impl<T: Real> Tiles<T> {
    /// Writes the images of the last [`blend`](Self::blend), which had the same `blending`, over a background color per
    /// view. Images cover the grid's region, `[V, h, w, channels]`, or `[V, K, h, w, channels]` of K groups.
    pub fn images(
        &self,
        blending: &Blending<'_, T>,
        background: impl Fn(usize) -> [T; 3] + Sync,
        images: Images<'_, T>,
    ) {
        let (channels, planes) = (blending.channels(), self.planes_per_window);
        let windows = WindowPlanes { planes: &self.planes, per_window: planes };
        self.assemble(images.alpha, windows, 1, |_, window, block, lane, out| {
            out.iter_mut().zip(&window[0][block].0[lane..]).for_each(|(out, &left)| *out = T::ONE - left);
        });
        if !images.image.is_empty() {
            self.assemble(images.image, windows, 3, |picture, window, block, lane, out| {
                let [left, red, green, blue] = [0, 1, 2, 3].map(|plane| &window[plane][block].0[lane..]);
                let background = background(picture / self.groups);
                for (i, pixel) in out.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                    *pixel = [
                        red[i] + left[i] * background[0],
                        green[i] + left[i] * background[1],
                        blue[i] + left[i] * background[2],
                    ];
                }
            });
        }
        if let Some(depth) = images.depth {
            self.assemble(depth, windows, 1, |_, window, block, lane, out| {
                out.copy_from_slice(&window[4][block].0[lane..][..out.len()]);
            });
        }
        if let Some(features) = images.features.filter(|features| !features.is_empty()) {
            let first = planes - channels;
            self.assemble(features, windows, channels, |_, window, block, lane, out| {
                for (i, pixel) in out.chunks_exact_mut(channels).enumerate() {
                    pixel.iter_mut().enumerate().for_each(|(c, x)| *x = window[first + c][block].0[lane + i]);
                }
            });
        }
    }

    /// Runs `body(picture, planes of the window, block, first lane, pixels)` on each row of each block, in parallel;
    /// `out` is `[V, K, h, w, channels]`.
    pub(super) fn assemble(
        &self,
        out: &mut [T],
        windows: WindowPlanes<'_, T>,
        channels: usize,
        body: impl Fn(usize, &[Plane<T>], usize, usize, &mut [T]) + Sync,
    ) {
        let grid = &self.grid;
        let (side, region) = (grid.side, grid.region);
        let across = side / SIDE;
        parallel::for_chunks(out, region.width * channels, |row, out| {
            let (picture, y) = (row / region.height, region.y + row % region.height);
            for (x, out) in cuts(region.x, SIDE, channels, out) {
                let tile = picture * grid.tiles() + grid.tile((x / side) as u32, (y / side) as u32) as usize;
                let window = tile * across * across + y % side / SIDE * across + x % side / SIDE;
                let planes = windows.of(window);
                for (x, out) in cuts(x, BLOCK, channels, out) {
                    let block = y % SIDE / BLOCK * BLOCK + x % SIDE / BLOCK;
                    body(picture, planes, block, y % BLOCK * BLOCK + x % BLOCK, out);
                }
            }
        });
    }
}

/// Cuts a row of pixels that starts at column `x` where columns are multiples of `side`: each part with its first
/// column.
fn cuts<T>(x: usize, side: usize, channels: usize, row: &mut [T]) -> impl Iterator<Item = (usize, &mut [T])> {
    let until = (side - x % side) * channels;
    let (first, rest) = row.split_at_mut(until.min(row.len()));
    let next = x - x % side + side;
    let rest = rest.chunks_mut(side * channels).enumerate().map(move |(i, part)| (next + i * side, part));
    std::iter::once((x, first)).chain(rest)
}
