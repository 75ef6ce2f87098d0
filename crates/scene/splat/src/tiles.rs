//! The tile layer: projecting, sorting, binning and blending of primitives, for any camera and shape.
//!
//! A kind of primitive says three things. A [`Projection`] turns primitives into records of sixteen numbers. A
//! [`Footprint`] says which pixels a record may cover. A [`Response`] gives its alpha at a pixel, and receives the
//! gradient there. Everything else is done here, for any such primitive: depth keys, a stable sort, lists of the tiles,
//! blending front to back, and blending backward, which leaves sums over pixels for each primitive.
//!
//! The Gaussians of [`rasterize`](crate::rasterize()) are one such kind: pinhole cameras and the EWA approximation. The
//! surfels of weaver-surfel are another, for spherical cameras too; `tests/it/spherical.rs` of this crate has a small
//! example with its gradient.

mod assemble;
mod backward;
mod blend;
mod blend_backward;
mod coverage;
mod forward;
mod gather;
mod grid;
mod hits;
mod lists;
mod primitive;
mod ranges;
mod removal;
mod sort;
mod traverse;
mod window;

pub use backward::BackwardPass;
pub use forward::{Blending, TileStats};
pub use grid::{Grid, Region, TileSide};
pub use primitive::{Footprint, MAX_SUMS, MAX_SUMS_WITH_STATISTICS, Projected, Projection, Response};
pub use removal::Compared;

pub(crate) use blend_backward::moment;
pub(crate) use coverage::{CHUNK, Chunk};
pub(crate) use window::BLOCK;

use lists::Lists;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, Row};
use window::Plane;

/// A primitive as one view sees it: one cache line in `f32`.
pub type Record<T> = Row<T>;

/// The numbers of a record that the tile layer reads.
pub mod record {
    /// Depth, by which primitives are ordered (ascending, as `f32`) and which the depth image blends.
    pub const DEPTH: usize = 7;
    /// Color toward the camera: red, green, blue, at `COLOR`, `COLOR + 1`, `COLOR + 2`.
    pub const COLOR: usize = 8;
}

/// Alpha below which a primitive leaves a pixel alone.
pub const ALPHA_MIN: f64 = 1.0 / 255.0;
/// A pixel ends before the primitive that would bring its transmittance to this or less.
pub const TRANSMITTANCE_END: f64 = 1e-4;

/// Primitives of several views in the lists of their tiles, and the result of blending them.
///
/// It only grows: calls of sizes seen before allocate nothing.
#[derive(Debug)]
pub struct Tiles<T> {
    /// The tiles of one view.
    grid: Grid,
    views: usize,
    /// Primitives, the same number in each view.
    per_view: usize,
    /// Pictures of each view, one for each group of primitives.
    groups: usize,
    /// `[V, N]`; a primitive that covers no tile has a stale record.
    records: Vec<Record<T>>,
    /// The tiles of the primitives, `[V, chunks]`.
    chunks: Vec<Chunk>,
    /// Keys of primitives by depth, and sorted, `[V, N]` each.
    keys: [Vec<AtomicU64>; 2],
    /// Counts of digits.
    counts: Vec<u32>,
    /// Where the sorted groups of a view end, `[K]`.
    ends: Vec<u32>,
    lists: Lists,
    /// State after blending in each window, `[V * K * tiles * windows, planes_per_window]`.
    planes: Vec<Plane<T>>,
    planes_per_window: usize,
    /// State that [`Tiles::ranges`] left in each window, `[V * K * tiles * windows, 4]`.
    range_planes: Vec<Plane<T>>,
    /// Sums over pixels of each list entry.
    moments: Vec<Row<T>>,
    /// Sums of features of each list entry, `[entries, C]`.
    feature_sums: Vec<T>,
    /// Background gradients of the tiles, `[V * K * tiles, 3]`.
    background_sums: Vec<[T; 3]>,
}

impl<T: Real> Tiles<T> {
    /// Without primitives.
    pub fn new() -> Self {
        Self {
            grid: Grid::new(Region::whole(0, 0), TileSide::Sixteen),
            views: 0,
            per_view: 0,
            groups: 1,
            records: Vec::new(),
            chunks: Vec::new(),
            keys: [Vec::new(), Vec::new()],
            counts: Vec::new(),
            ends: Vec::new(),
            lists: Lists::default(),
            planes: Vec::new(),
            planes_per_window: 0,
            range_planes: Vec::new(),
            moments: Vec::new(),
            feature_sums: Vec::new(),
            background_sums: Vec::new(),
        }
    }

    /// Number of tiles of all views.
    fn tiles(&self) -> usize {
        self.views * self.tiles_per_view()
    }

    /// Chunks of primitives in a view.
    fn chunks_per_view(&self) -> usize {
        self.per_view.div_ceil(CHUNK)
    }

    /// The chunk of primitive `n` in view `v`, and its place in the chunk.
    pub(crate) fn chunk(&self, v: usize, n: usize) -> (&Chunk, usize) {
        (&self.chunks[v * self.chunks_per_view() + n / CHUNK], n % CHUNK)
    }

    /// The record of primitive `n` in view `v`; of any content if it covers no tile.
    pub fn record(&self, v: usize, n: usize) -> &Record<T> {
        &self.records[v * self.per_view + n]
    }

    /// True if primitive `n` covers no tile of view `v`.
    pub(crate) fn is_unseen(&self, v: usize, n: usize) -> bool {
        let (chunk, i) = self.chunk(v, n);
        chunk.places(i).is_empty()
    }

    /// The sums over pixels of list entries.
    pub(crate) fn moments(&self) -> &[Row<T>] {
        &self.moments
    }

    /// The sums over pixels of the entries of primitive `n` in view `v`.
    pub(crate) fn entries(&self, v: usize, n: usize) -> impl Iterator<Item = &[T; LANES]> {
        let (chunk, i) = self.chunk(v, n);
        chunk.places(i).iter().map(|place| &self.moments[place.load(Relaxed) as usize].0)
    }

    /// The sums of `channels` features of the entries of primitive `n` in view `v`.
    pub(crate) fn feature_entries(&self, v: usize, n: usize, channels: usize) -> impl Iterator<Item = &[T]> + Clone {
        let (chunk, i) = self.chunk(v, n);
        chunk
            .places(i)
            .iter()
            .map(move |place| &self.feature_sums[place.load(Relaxed) as usize * channels..][..channels])
    }

    /// Background gradients of the tiles of the views, in order, `[V * K * tiles]`.
    pub(crate) fn background_sums(&self) -> &[[T; 3]] {
        &self.background_sums[..self.tiles()]
    }

    /// Tiles of a view, over all its pictures.
    pub(crate) fn tiles_per_view(&self) -> usize {
        self.groups * self.grid.tiles()
    }
}

impl<T: Real> Default for Tiles<T> {
    fn default() -> Self {
        Self::new()
    }
}
