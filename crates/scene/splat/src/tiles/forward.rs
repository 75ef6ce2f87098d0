//! Forward: project, sort, bin, blend.

use super::blend::Blend;
use super::coverage::{CHUNK, Chunk, Coverage};
use super::lists::Picture;
use super::primitive::{Footprint, Projection, Response};
use super::sort::{sort, split};
use super::traverse::{Work, traverse};
use super::window::{Plane, windows_of, windows_per_tile};
use super::{Grid, Record, Tiles};
use crate::error::RasterError;
use crate::memory::grown;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
use weaver_kernels::lanes::{self, LaneKernel, Lanes};
use weaver_kernels::{Real, parallel};
use weaver_scene::{Features, Groups};

/// Settings of blending primitives.
#[derive(Clone, Copy, Debug)]
pub struct Blending<'a, T> {
    /// Largest alpha of one primitive at one pixel.
    pub alpha_max: f64,
    /// True if depth is blended.
    pub depth: bool,
    /// Features of the primitives to blend, the same in all views.
    pub features: Option<Features<'a, T>>,
}

impl<T> Blending<'_, T> {
    /// Number of features.
    pub(crate) fn channels(&self) -> usize {
        self.features.as_ref().map_or(0, |features| features.channels)
    }
}

/// The forms of blending that are compiled beside the one with everything.
pub(crate) struct Forms {
    /// Without depth.
    pub without_depth: bool,
    /// Without features and statistics.
    pub without_more: bool,
}

impl Forms {
    /// One form has to do in double precision, which is for checks of gradients.
    pub(crate) const fn of<T, P: Response>() -> Self {
        let single = size_of::<T>() == size_of::<f32>();
        Self { without_depth: single && P::WITHOUT_DEPTH, without_more: single }
    }
}

/// Statistics of projecting, summed over the views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TileStats {
    /// Primitives that cover a tile.
    pub covered: usize,
    /// Primitives over tiles: the entries of all lists.
    pub entries: usize,
    /// Primitives left out because of numbers that are not finite.
    pub rejected: usize,
}

impl<T: Real> Tiles<T> {
    /// Projects `per_view` primitives into each of `views` views and finds the tiles of `grid` that they cover.
    ///
    /// # Errors
    ///
    /// More than 2^32 list entries.
    #[inline(never)]
    pub fn project<P: Projection<T>, F: Footprint>(
        &mut self,
        grid: Grid,
        views: usize,
        per_view: usize,
        projection: &P,
        footprint: &F,
    ) -> Result<TileStats, RasterError> {
        (self.grid, self.views, self.per_view, self.groups) = (grid, views, per_view, 1);
        let chunks = self.chunks_per_view();
        // Chunks of an earlier, larger call would be counted; their memory goes.
        self.chunks.truncate(views * chunks);
        let chunks_of_views = grown(&mut self.chunks, views * chunks).chunks_mut(chunks.max(1));
        let records = grown(&mut self.records, views * per_view).chunks_mut(per_view.max(1));
        let [keys, sorted] = &mut self.keys;
        grown(sorted, views * per_view);
        let keys = grown(keys, views * per_view).chunks_mut(per_view.max(1));
        for (view, (chunks, (records, keys))) in chunks_of_views.zip(records.zip(keys)).enumerate() {
            let parts = (chunks, records.par_chunks_mut(CHUNK), keys.par_chunks_mut(CHUNK));
            parts.into_par_iter().enumerate().for_each(|(i, (chunk, records, keys))| {
                let first = i * CHUNK;
                lanes::run(Coverage { projection, footprint, grid: &grid, view, first, records, keys, chunk });
            });
        }
        let count = |of: fn(&Chunk) -> usize| self.chunks.iter().map(of).sum();
        let stats = TileStats {
            covered: count(|chunk| chunk.covered),
            entries: count(Chunk::len),
            rejected: count(|chunk| chunk.rejected),
        };
        if stats.entries > u32::MAX as usize {
            return Err(RasterError::TooMany(format!("{} list entries are too many for one call", stats.entries)));
        }
        Ok(stats)
    }

    /// Sorts the projected primitives of each picture by depth, ties by index, and puts them into the lists of its
    /// tiles. A view has one picture, or one for each of `groups` of primitives.
    #[inline(never)]
    pub fn bin(&mut self, groups: Option<Groups<'_>>) {
        self.groups = groups.map_or(1, |groups| groups.count);
        let (per_view, chunks) = (self.per_view, self.chunks_per_view());
        let entries = self.chunks.iter().map(Chunk::len).sum();
        self.lists.prepare(self.tiles(), entries);
        let [keys, sorted] = &mut self.keys;
        for v in 0..self.views {
            let part = v * per_view..(v + 1) * per_view;
            let chunks = &self.chunks[v * chunks..(v + 1) * chunks];
            let (mut keys, mut sorted) = (&mut keys[part.clone()], &mut sorted[part]);
            match groups {
                Some(groups) => {
                    split(keys, sorted, groups, &mut self.counts, &mut self.ends);
                    std::mem::swap(&mut keys, &mut sorted);
                }
                None => {
                    self.ends.clear();
                    self.ends.push(per_view as u32);
                }
            }
            let mut start = 0;
            for (group, end) in self.ends.iter().enumerate() {
                let part = start..*end as usize;
                start = part.end;
                let (keys, sorted) = (&mut keys[part.clone()], &mut sorted[part]);
                let seen = sort(keys, sorted, &mut self.counts);
                let picture = Picture { number: v * self.groups + group, first: v * per_view, chunks };
                self.lists.bin(picture, self.grid.tiles(), &sorted[..seen]);
            }
        }
    }

    /// Blends the lists front to back; [`images`](Self::images) puts the result together.
    ///
    /// Returns how many pairs of a primitive and a pixel that it adds to there were, and how many pairs were evaluated.
    #[inline(never)]
    pub fn blend<P: Footprint + Response>(&mut self, primitive: &P, blending: &Blending<'_, T>) -> [u64; 2] {
        let features = blending.channels() > 0;
        // Constants come first, so that forms that are never used are not compiled.
        let work = if const { Forms::of::<T, P>().without_depth } && !blending.depth {
            match features {
                false => self.blend_tiles::<P, 3, false>(primitive, blending),
                true => self.blend_tiles::<P, 3, true>(primitive, blending),
            }
        } else if const { Forms::of::<T, P>().without_more } && !features {
            self.blend_tiles::<P, 4, false>(primitive, blending)
        } else {
            self.blend_tiles::<P, 4, true>(primitive, blending)
        };
        [work.pairs, work.evaluated]
    }

    fn blend_tiles<P: Footprint + Response, const C: usize, const MORE: bool>(
        &mut self,
        primitive: &P,
        blending: &Blending<'_, T>,
    ) -> Work {
        let tiles = self.tiles();
        let Self { grid, lists, records, per_view, .. } = self;
        self.planes_per_window = 1 + C + blending.channels();
        let per_tile = windows_per_tile(grid) * self.planes_per_window;
        let planes = grown(&mut self.planes, tiles * per_tile);
        let (pairs, evaluated) = (AtomicU64::new(0), AtomicU64::new(0));
        parallel::for_chunks(planes, per_tile, |tile, planes| {
            let work = lanes::run(BlendTile::<T, P, C, MORE> {
                primitive,
                blending,
                grid,
                tile,
                list: lists.of_tile(tile),
                records,
                per_view: *per_view,
                planes,
            });
            pairs.fetch_add(work.pairs, Relaxed);
            evaluated.fetch_add(work.evaluated, Relaxed);
        });
        Work { pairs: pairs.into_inner(), evaluated: evaluated.into_inner() }
    }
}

/// Blends the windows of a tile.
struct BlendTile<'a, T, P, const C: usize, const MORE: bool> {
    primitive: &'a P,
    blending: &'a Blending<'a, T>,
    grid: &'a Grid,
    tile: usize,
    list: &'a [AtomicU32],
    records: &'a [Record<T>],
    per_view: usize,
    /// Of all windows.
    planes: &'a mut [Plane<T>],
}

impl<T: Real, P: Footprint + Response, const C: usize, const MORE: bool> LaneKernel<T>
    for BlendTile<'_, T, P, C, MORE>
{
    type Output = Work;

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> Work {
        let per_window = self.planes.len() / windows_per_tile(self.grid);
        let Self { primitive, blending, list, records, .. } = self;
        let Blending { alpha_max, features, .. } = *blending;
        let mut total = Work::default();
        for (i, window) in windows_of(self.grid, self.tile) {
            let [transmittance, planes @ ..] = &mut self.planes[i * per_window..][..per_window] else { continue };
            let mut blend = Blend::<V::Part, P, C, MORE>::new(primitive, features, self.per_view, planes);
            let work = traverse::<V, P>(primitive, alpha_max, &window, list, records, transmittance, &mut blend);
            blend.finish();
            total.pairs += work.pairs;
            total.evaluated += work.evaluated;
        }
        total
    }
}
