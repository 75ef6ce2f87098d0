//! Which splats each tile has to look at, in drawing order.
//!
//! Splats are sorted by depth once per view, then dealt to the tiles in that order: a stable counting sort, parallel
//! over chunks of the sorted list. A tile gets a splat if the ellipse within the splat's reach touches one of its
//! pixel centres' rows; the ellipse is rounded outwards, and each pixel decides for itself, so tiles leave no trace
//! in an image.

use crate::project::{Splat, Unseen};
use crate::scene::Extent;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use weaver_kernels::{Real, parallel, simd};

/// The tiles of one view.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Grid {
    pub width: usize,
    pub height: usize,
    /// Pixels per tile side.
    pub side: usize,
    /// Tiles side by side.
    pub columns: usize,
    /// Tiles below each other.
    pub rows: usize,
}

impl Grid {
    pub fn new(extent: &Extent) -> Self {
        let Extent { width, height, side, .. } = *extent;
        Self { width, height, side, columns: width.div_ceil(side), rows: height.div_ceil(side) }
    }

    /// Number of tiles.
    pub fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// Left and top pixel of tile `t`.
    pub fn corner(&self, t: usize) -> (usize, usize) {
        (t % self.columns * self.side, t / self.columns * self.side)
    }

    /// Calls `body` with each tile that `splat` may be seen in, row by row.
    #[inline(always)]
    pub fn for_each_tile<T: Real>(&self, splat: &Splat<T>, mut body: impl FnMut(usize)) {
        let ellipse = Ellipse::new(splat);
        let rows = centres(ellipse.y - ellipse.half_height, ellipse.y + ellipse.half_height, self.height);
        if rows.is_empty() {
            return;
        }
        for row in rows.start / self.side..=(rows.end - 1) / self.side {
            let top = (row * self.side) as f64 + 0.5;
            let bottom = (row * self.side + self.side) as f64 - 0.5;
            let (left, right) = ellipse.span(top, bottom);
            let columns = centres(left, right, self.width);
            if !columns.is_empty() {
                let first = row * self.columns;
                (columns.start / self.side..=(columns.end - 1) / self.side).for_each(|column| body(first + column));
            }
        }
    }
}

/// The pixels in `0..size` with centres in (low, high].
#[inline(always)]
pub(crate) fn centres(low: f64, high: f64, size: usize) -> Range<usize> {
    // Casts round towards zero and saturate, and what is not a number becomes 0.
    let start = (low + 0.5).max(0.0) as usize;
    let end = (high + 0.5).max(0.0) as usize;
    start..end.min(size)
}

/// The pixels' centres where a splat may be seen: u^2 + v^2 <= reach^2 with u = p dx + q dy, v = r dy.
struct Ellipse {
    x: f64,
    y: f64,
    p: f64,
    q: f64,
    r: f64,
    reach: f64,
    /// Largest |dy|, rounded up.
    half_height: f64,
    /// dy where x is largest; x is smallest at its negative.
    dy_of_right: f64,
    /// Added to x on both sides against rounding.
    slack: f64,
}

impl Ellipse {
    #[inline(always)]
    fn new<T: Real>(splat: &Splat<T>) -> Self {
        let [x, y, p, q, r, reach] = [splat.x, splat.y, splat.p, splat.q, splat.r, splat.reach].map(T::to_f64);
        // What dx and dy may be off by when computed in T.
        let slack = 1e-3 + 4.0 * T::EPSILON.to_f64() * (x.abs() + y.abs());
        let half_height = reach / r + slack;
        let dy_of_right = -q * reach / (r * (r * r + q * q).sqrt());
        Self { x, y, p, q, r, reach, half_height, dy_of_right, slack }
    }

    /// Smallest and largest x of the ellipse between two rows of pixel centres.
    #[inline(always)]
    fn span(&self, top: f64, bottom: f64) -> (f64, f64) {
        // The slack applies to dy as well: the rows may be that much farther.
        let low = (top - self.y - self.slack).max(-self.half_height);
        let high = (bottom - self.y + self.slack).min(self.half_height);
        let half_width = |dy: f64| (self.reach * self.reach - self.r * self.r * dy * dy).max(0.0).sqrt();
        let at_right = self.dy_of_right.min(high).max(low);
        let at_left = (-self.dy_of_right).min(high).max(low);
        let right = self.x + (half_width(at_right) - self.q * at_right) / self.p;
        let left = self.x - (half_width(at_left) + self.q * at_left) / self.p;
        (left - self.slack, right + self.slack)
    }
}

/// Sort key of a Gaussian that is culled; above all keys of splats.
pub(crate) const CULLED: u64 = u64::MAX;
/// Sort key of a Gaussian that was rejected.
pub(crate) const REJECTED: u64 = u64::MAX - 1;

/// The key that sorts by depth in `f32`, ties by index.
#[inline(always)]
pub(crate) fn depth_key<T: Real>(z: T, index: usize) -> u64 {
    let bits = z.to_f32().to_bits();
    let ordered = if bits >> 31 == 0 { bits | 1 << 31 } else { !bits };
    u64::from(ordered) << 32 | index as u64
}

/// The key of a Gaussian without a splat.
pub(crate) fn unseen_key(why: Unseen) -> u64 {
    match why {
        Unseen::Culled => CULLED,
        Unseen::Rejected => REJECTED,
    }
}

/// Moves the splats of each view to the front, by depth; returns how many were rejected.
pub(crate) fn sort_by_depth(keys: &mut [u64], gaussians: usize) -> usize {
    let rejected = AtomicU32::new(0);
    parallel::for_chunks(keys, gaussians, |_, keys| {
        let (mut seen, mut bad) = (0, 0);
        for i in 0..keys.len() {
            let key = keys[i];
            bad += u32::from(key == REJECTED);
            if key < REJECTED {
                keys[seen] = key;
                seen += 1;
            }
        }
        keys[seen..].fill(CULLED);
        keys[..seen].par_sort_unstable();
        rejected.fetch_add(bad, Relaxed);
    });
    rejected.into_inner() as usize
}

/// The lists of all tiles of all views, one after the other.
#[derive(Debug, Default)]
pub(crate) struct TileLists {
    /// Splats of each chunk of sorted splats in each tile, then where the next of them goes: `[V, chunks, tiles]`.
    cursors: Vec<u32>,
    /// Where each tile's list starts in `splats`, `[V * tiles + 1]`.
    starts: Vec<u32>,
    /// Splats (v N + n), tile by tile, front to back.
    splats: Vec<AtomicU32>,
    /// Where the entries of each splat stand in `splats`; those of splat i are at `offsets[i]..offsets[i + 1]`.
    places: Vec<AtomicU32>,
    len: usize,
}

/// A vector grown to at least `len` elements, and its first `len`.
pub(crate) fn grown<U: Default>(values: &mut Vec<U>, len: usize) -> &mut [U] {
    if values.len() < len {
        values.resize_with(len, U::default);
    }
    &mut values[..len]
}

impl TileLists {
    /// Deals the splats out. `offsets` (one more than there are splats) are the running sums of how many tiles each
    /// splat touches.
    pub fn deal<T: Real>(&mut self, extent: &Extent, splats: &[Splat<T>], keys: &[u64], offsets: &[u32]) {
        let Extent { gaussians, views, .. } = *extent;
        let grid = Grid::new(extent);
        let tiles = grid.len();
        // At most 64 chunks a view bound the memory; the result does not depend on it.
        let chunk_len = gaussians.div_ceil(64).max(512);
        let chunks = gaussians.div_ceil(chunk_len);
        self.len = offsets.last().map_or(0, |&total| total as usize);
        let seen = |row: usize| {
            let (view, chunk) = (row / chunks, row % chunks);
            let keys = &keys[view * gaussians..][chunk * chunk_len..((chunk + 1) * chunk_len).min(gaussians)];
            keys.iter().take_while(|&&key| key != CULLED).map(move |&key| view * gaussians + (key as u32) as usize)
        };
        let cursors = grown(&mut self.cursors, views * chunks * tiles);
        parallel::for_chunks(cursors, tiles, |row, count| {
            count.fill(0);
            simd::dispatch(
                #[inline(always)]
                || seen(row).for_each(|id| grid.for_each_tile(&splats[id], |t| count[t] += 1)),
            );
        });
        let starts = grown(&mut self.starts, views * tiles + 1);
        let mut next = 0;
        for view in 0..views {
            for tile in 0..tiles {
                starts[view * tiles + tile] = next;
                for chunk in 0..chunks {
                    let cursor = &mut cursors[(view * chunks + chunk) * tiles + tile];
                    let count = *cursor;
                    *cursor = next;
                    next += count;
                }
            }
        }
        starts[views * tiles] = next;
        let list = &*grown(&mut self.splats, self.len);
        let places = &*grown(&mut self.places, self.len);
        parallel::for_chunks(cursors, tiles, |row, cursor| {
            simd::dispatch(
                #[inline(always)]
                || {
                    seen(row).for_each(|id| {
                        let mut place = offsets[id] as usize;
                        grid.for_each_tile(&splats[id], |t| {
                            list[cursor[t] as usize].store(id as u32, Relaxed);
                            places[place].store(cursor[t], Relaxed);
                            place += 1;
                            cursor[t] += 1;
                        });
                    });
                },
            );
        });
    }

    /// Entries of all lists together.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Where tile `t` (of all views) has its entries.
    pub fn range(&self, t: usize) -> Range<usize> {
        self.starts[t] as usize..self.starts[t + 1] as usize
    }

    /// The splat at an entry.
    #[inline(always)]
    pub fn splat(&self, entry: usize) -> usize {
        self.splats[entry].load(Relaxed) as usize
    }

    /// The entries of the splat whose offsets are `range`, tile by tile.
    #[inline(always)]
    pub fn entries(&self, range: Range<usize>) -> impl Iterator<Item = usize> {
        self.places[range].iter().map(|place| place.load(Relaxed) as usize)
    }
}
