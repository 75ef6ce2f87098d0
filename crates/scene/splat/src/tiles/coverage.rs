//! Tile coverage: which tiles each primitive may be seen in.
//!
//! A tile gets a primitive if its outline touches one of the tile's rows of pixel centers. Outlines are rounded
//! outward, and each pixel decides for itself, so that tiles leave no trace in an image.

use super::primitive::{Footprint, Projection};
use super::{Grid, Record};
use std::ops::Range;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, LaneKernel, LaneMask, Lanes};
use weaver_kernels::simd::prefetch;

/// Primitives in a [`Chunk`].
pub(crate) const CHUNK: usize = 512;

/// The sort key of a primitive that covers no tile; above all other keys.
pub(crate) const UNSEEN: u64 = u64::MAX;

/// The tiles of consecutive primitives of a view.
#[derive(Debug, Default)]
pub(crate) struct Chunk {
    /// Start of each primitive's tiles, and the end of the last one's, `[primitives + 1]`.
    starts: Vec<u32>,
    /// Tiles, primitive by primitive; binning replaces each by the place of its entry in the tiles' lists.
    places: Vec<AtomicU32>,
    /// Columns touched in each row of tiles, for the sixteen primitives at hand.
    spans: Vec<[Range<u32>; LANES]>,
    /// Columns of the second intervals, where outlines have two.
    second_spans: Vec<[Range<u32>; LANES]>,
    /// Primitives that cover a tile.
    pub covered: usize,
    /// Primitives with numbers that are not finite.
    pub rejected: usize,
}

impl Chunk {
    /// The places of primitive `i` of the chunk.
    #[inline(always)]
    pub fn places(&self, i: usize) -> &[AtomicU32] {
        &self.places[self.starts[i] as usize..self.starts[i + 1] as usize]
    }

    /// Prefetches the start that [`Self::prefetch_places`] will read.
    #[inline(always)]
    pub fn prefetch_start(&self, i: usize) {
        prefetch(&self.starts[i]);
    }

    /// Prefetches the places of primitive `i`.
    #[inline(always)]
    pub fn prefetch_places(&self, i: usize) {
        self.places.get(self.starts[i] as usize).into_iter().for_each(|x| prefetch(x));
    }

    /// Tiles of all primitives together.
    pub fn len(&self) -> usize {
        self.places.len()
    }
}

/// Projects a chunk of primitives and finds their tiles.
pub(crate) struct Coverage<'a, P, F, T> {
    pub projection: &'a P,
    pub footprint: &'a F,
    pub grid: &'a Grid,
    pub view: usize,
    /// The first primitive; one for each record follows.
    pub first: usize,
    pub records: &'a mut [Record<T>],
    pub keys: &'a mut [AtomicU64],
    pub chunk: &'a mut Chunk,
}

/// The key that sorts by depth in `f32`, ties by index.
#[inline(always)]
fn depth_key<T: Real>(z: T, index: usize) -> u64 {
    let bits = z.to_f32().to_bits();
    let ordered = if bits >> 31 == 0 { bits | 1 << 31 } else { !bits };
    u64::from(ordered) << 32 | index as u64
}

impl<T: Real, P: Projection<T>, F: Footprint> LaneKernel<T> for Coverage<'_, P, F, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let Self { projection, footprint, grid, view, first, records: out, keys, chunk } = self;
        let mut state = projection.begin::<V>(view);
        chunk.starts.clear();
        chunk.starts.push(0);
        chunk.places.clear();
        (chunk.covered, chunk.rejected) = (0, 0);
        let groups = out.chunks_mut(LANES).zip(keys.chunks_mut(LANES));
        for (group, (out, keys)) in groups.enumerate() {
            let first = first + group * LANES;
            let projected = projection.project(&mut state, first, out.len());
            let seen = projected.seen.bits();
            chunk.rejected += projected.rejected.bits().count_ones() as usize;
            let rows = rows_of(footprint, &projected.columns, seen, grid, [&mut chunk.spans, &mut chunk.second_spans]);
            let z = projected.depth().to_array();
            let mut records = projected.columns;
            V::transpose(&mut records);
            for lane in 0..out.len() {
                records[lane].store(&mut out[lane].0);
                let before = chunk.places.len();
                for (row, span) in rows[lane].clone().zip(&chunk.spans) {
                    let tiles = span[lane].clone().map(|column| AtomicU32::new(grid.tile(column, row)));
                    chunk.places.extend(tiles);
                }
                for (row, span) in rows[lane].clone().zip(&chunk.second_spans) {
                    chunk.places.extend(span[lane].clone().map(|column| AtomicU32::new(grid.tile(column, row))));
                }
                let after = chunk.places.len();
                chunk.starts.push(after as u32);
                chunk.covered += usize::from(after > before);
                let key = if after > before { depth_key(z[lane], first + lane) } else { UNSEEN };
                keys[lane].store(key, Relaxed);
            }
        }
    }
}

/// The rows of tiles that each outline touches, and in `spans[k]` the columns in the k-th of them. Second intervals
/// share no column with the first.
#[inline(always)]
fn rows_of<V: Lanes>(
    footprint: &impl Footprint,
    columns: &[V; LANES],
    seen: u16,
    grid: &Grid,
    [spans, second_spans]: [&mut Vec<[Range<u32>; LANES]>; 2],
) -> [Range<u32>; LANES] {
    let (top, bottom) = footprint.rows(columns);
    let (top, bottom) = (top.to_array(), bottom.to_array());
    let rows: [Range<u32>; LANES] = std::array::from_fn(|lane| {
        if seen >> lane & 1 == 0 {
            return 0..0;
        }
        grid.touched(1, top[lane].to_f64(), bottom[lane].to_f64())
    });
    let side = V::constant(grid.side as f64);
    let first = V::from_fn(|lane| V::Scalar::from_f64(f64::from(rows[lane].start) * grid.side as f64 + 0.5));
    let most = rows.iter().map(|rows| rows.len()).max().unwrap_or(0);
    spans.clear();
    second_spans.clear();
    for k in 0..most {
        let top = V::constant(k as f64).mul_add(side, first);
        let bottom = top + side - V::constant(1.0);
        spans.push(columns_of(footprint.span(columns, top, bottom), grid));
        if let Some(second) = footprint.second_span(columns, top, bottom) {
            let mut second = columns_of::<V>(second, grid);
            let first = spans.last_mut().into_iter().flatten();
            first.zip(&mut second).for_each(|(first, second)| part(first, second));
            second_spans.push(second);
        }
    }
    rows
}

/// The columns of tiles that intervals of x touch.
#[inline(always)]
fn columns_of<V: Lanes>((left, right, touched): (V, V, V::Mask), grid: &Grid) -> [Range<u32>; LANES] {
    let (left, right, touched) = (left.to_array(), right.to_array(), touched.bits());
    std::array::from_fn(|lane| {
        if touched >> lane & 1 == 0 {
            return 0..0;
        }
        grid.touched(0, left[lane].to_f64(), right[lane].to_f64())
    })
}

/// Merges two ranges into the first where they share a column: a tile has a primitive once.
fn part(first: &mut Range<u32>, second: &mut Range<u32>) {
    if first.start.max(second.start) < first.end.min(second.end) {
        *first = first.start.min(second.start)..first.end.max(second.end);
        *second = 0..0;
    }
}
