//! Which tiles each splat may be seen in.
//!
//! A tile gets a splat if the outline touches one of its rows of pixel centers. Outlines are rounded outward, and each
//! pixel decides for itself, so that tiles leave no trace in an image.

use crate::project::{Coefficients, splats};
use crate::scene::{Extent, RasterSettings, Viewpoint};
use crate::splat::{Outline, Splat};
use std::ops::Range;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, LaneKernel, LaneMask, Lanes};
use weaver_kernels::simd::prefetch;
use weaver_scene::GaussianSlices;

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

    /// The tiles, of `count` in a row, with a pixel center in `[low, high]`.
    #[inline(always)]
    fn touched(&self, low: f64, high: f64, count: usize) -> Range<u32> {
        let side = self.side as f64;
        // Casts saturate, and what is not a number becomes 0.
        let start = ((low - side + 0.5) / side).ceil() as u32;
        let end = ((high - 0.5) / side + 1.0).floor() as u32;
        start..end.min(count as u32)
    }
}

/// Gaussians in a [`Chunk`].
pub(crate) const GRAIN: usize = 512;

/// The sort key of a Gaussian without a splat; above all keys of splats.
pub(crate) const UNSEEN: u64 = u64::MAX;

/// The tiles of consecutive Gaussians of a view.
#[derive(Debug, Default)]
pub(crate) struct Chunk {
    /// Where the tiles of each Gaussian begin, and where the last's end, `[Gaussians + 1]`.
    starts: Vec<u32>,
    /// Tiles, Gaussian by Gaussian; dealing replaces each by where in the tiles' lists its entry went.
    places: Vec<AtomicU32>,
    /// Columns touched in each row of tiles, for the sixteen Gaussians at hand.
    spans: Vec<[Range<u32>; LANES]>,
    /// Gaussians with splats.
    pub splats: usize,
    /// Gaussians with numbers that are not finite.
    pub rejected: usize,
}

impl Chunk {
    /// The places of Gaussian `i` of the chunk.
    #[inline(always)]
    pub fn places(&self, i: usize) -> &[AtomicU32] {
        &self.places[self.starts[i] as usize..self.starts[i + 1] as usize]
    }

    /// Asks for what [`Self::prefetch_places`] will look at.
    #[inline(always)]
    pub fn prefetch_start(&self, i: usize) {
        prefetch(&self.starts[i]);
    }

    /// Asks for the places of Gaussian `i`.
    #[inline(always)]
    pub fn prefetch_places(&self, i: usize) {
        self.places.get(self.starts[i] as usize).into_iter().for_each(|x| prefetch(x));
    }

    /// Tiles of all Gaussians together.
    pub fn len(&self) -> usize {
        self.places.len()
    }
}

/// Projects a chunk of Gaussians and finds their tiles.
pub(crate) struct Cover<'a, T> {
    pub view: &'a Viewpoint<T>,
    pub settings: &'a RasterSettings,
    pub gaussians: &'a GaussianSlices<'a, T>,
    pub grid: &'a Grid,
    /// The first Gaussian; as many as there are splats follow.
    pub first: usize,
    pub splats: &'a mut [Splat<T>],
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

impl<T: Real> LaneKernel<T> for Cover<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let Self { view, settings, gaussians, grid, first, splats: out, keys, chunk } = self;
        let view = view.in_lanes::<V>();
        let mut coefficients: Coefficients<V> = [V::zero(); _];
        chunk.starts.clear();
        chunk.starts.push(0);
        chunk.places.clear();
        (chunk.splats, chunk.rejected) = (0, 0);
        let groups = out.chunks_mut(LANES).zip(keys.chunks_mut(LANES));
        for (group, (out, keys)) in groups.enumerate() {
            let first = first + group * LANES;
            let projected = splats(&view, settings, gaussians, (first, out.len()), &mut coefficients);
            let seen = projected.seen.bits();
            chunk.rejected += projected.rejected.bits().count_ones() as usize;
            let rows = rows_of(&Outline::of_columns(&projected.columns), seen, grid, &mut chunk.spans);
            let z = projected.columns[crate::splat::slot::Z].to_array();
            let mut records = projected.columns;
            V::transpose(&mut records);
            for lane in 0..out.len() {
                records[lane].store(&mut out[lane].0);
                let before = chunk.places.len();
                for (row, span) in rows[lane].clone().zip(&chunk.spans) {
                    let tile = row * grid.columns as u32;
                    span[lane].clone().for_each(|column| chunk.places.push(AtomicU32::new(tile + column)));
                }
                let after = chunk.places.len();
                chunk.starts.push(after as u32);
                chunk.splats += usize::from(after > before);
                let key = if after > before { depth_key(z[lane], first + lane) } else { UNSEEN };
                keys[lane].store(key, Relaxed);
            }
        }
    }
}

/// The rows of tiles that each outline touches, and in `spans[k]` the columns in the k-th of them.
#[inline(always)]
fn rows_of<V: Lanes>(
    outline: &Outline<V>,
    seen: u16,
    grid: &Grid,
    spans: &mut Vec<[Range<u32>; LANES]>,
) -> [Range<u32>; LANES] {
    let top = (outline.y - outline.half_height).to_array();
    let bottom = (outline.y + outline.half_height).to_array();
    let rows: [Range<u32>; LANES] = std::array::from_fn(|lane| {
        if seen >> lane & 1 == 0 {
            return 0..0;
        }
        grid.touched(top[lane].to_f64(), bottom[lane].to_f64(), grid.rows)
    });
    let side = V::constant(grid.side as f64);
    let first = V::from_fn(|lane| V::Scalar::from_f64(f64::from(rows[lane].start) * grid.side as f64 + 0.5));
    let most = rows.iter().map(|rows| rows.len()).max().unwrap_or(0);
    spans.clear();
    for k in 0..most {
        let top = V::constant(k as f64).mul_add(side, first);
        let (left, right, touched) = outline.span(top, top + side - V::constant(1.0));
        let (left, right, touched) = (left.to_array(), right.to_array(), touched.bits());
        spans.push(std::array::from_fn(|lane| {
            if touched >> lane & 1 == 0 {
                return 0..0;
            }
            grid.touched(left[lane].to_f64(), right[lane].to_f64(), grid.columns)
        }));
    }
    rows
}
