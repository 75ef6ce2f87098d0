//! Backward: from cotangents of the images to sums over pixels for each list entry.

use super::blend_backward::{Attributes, BlendBackward, EntrySums, PictureCotangents, prepare};
use super::forward::Forms;
use super::lists::Lists;
use super::primitive::{Footprint, Response};
use super::traverse::traverse;
use super::window::{Plane, windows_of, windows_per_tile};
use super::{Blending, Grid, Record, Tiles, moment};
use crate::gradients::Cotangents;
use crate::memory::grown;
use std::ops::Range;
use std::sync::atomic::AtomicU32;
use weaver_kernels::Real;
use weaver_kernels::lanes::{self, LANES, LaneKernel, Lanes, Row};

/// Inputs of a backward pass over the tiles.
#[derive(Clone, Copy, Debug)]
pub struct BackwardPass<'a, T> {
    /// As in the forward pass.
    pub blending: Blending<'a, T>,
    /// Gradients that arrive at the images.
    pub cotangents: Cotangents<'a, T>,
    /// Also sums the parts of [`GaussianStatistics`](crate::GaussianStatistics); only where there is room for them
    /// ([`MAX_SUMS_WITH_STATISTICS`](super::MAX_SUMS_WITH_STATISTICS)).
    pub statistics: bool,
}

impl<T: Real> Tiles<T> {
    /// Sums over pixels, for each list entry, the gradients from the images of the last [`blend`](Self::blend).
    ///
    /// [`sums`](Self::sums) reads the result. `background` is the background color per view.
    pub fn backward<P: Footprint + Response>(
        &mut self,
        primitive: &P,
        pass: &BackwardPass<'_, T>,
        background: impl Fn(usize) -> [T; 3] + Sync,
    ) {
        let channels = pass.blending.channels();
        let entries = self.lists.len();
        grown(&mut self.moments, entries);
        grown(&mut self.feature_sums, entries * channels);
        let tiles = self.tiles();
        grown(&mut self.background_sums, tiles);
        let more = channels > 0 || pass.statistics;
        if const { Forms::of::<T, P>().without_depth } && !pass.blending.depth {
            match more {
                false => self.backward_tiles::<P, 3, false>(primitive, pass, &background),
                true => self.backward_tiles::<P, 3, true>(primitive, pass, &background),
            }
        } else if const { Forms::of::<T, P>().without_more } && !more {
            self.backward_tiles::<P, 4, false>(primitive, pass, &background);
        } else {
            self.backward_tiles::<P, 4, true>(primitive, pass, &background);
        }
    }

    /// Runs [`BackwardTile`] on each tile; a tile owns the sums of its entries.
    #[inline(never)]
    fn backward_tiles<P: Footprint + Response, const C: usize, const MORE: bool>(
        &mut self,
        primitive: &P,
        pass: &BackwardPass<'_, T>,
        background: &(dyn Fn(usize) -> [T; 3] + Sync),
    ) {
        let tiles = self.tiles();
        let groups = self.groups;
        let Self { grid, records, lists, planes, moments, feature_sums, background_sums, per_view, .. } = self;
        let channels = pass.blending.channels();
        let per_tile = windows_per_tile(grid) * self.planes_per_window;
        let entries = lists.len();
        let sums = Sums {
            moments: &mut moments[..entries],
            features: &mut feature_sums[..entries * channels],
            channels,
            background: &mut background_sums[..tiles],
        };
        let pixels = grid.region.pixels();
        for_tiles(lists, 0..tiles, sums, &|tile, sums: Sums<'_, T>| {
            let picture = tile / grid.tiles();
            sums.background[0] = lanes::run(BackwardTile::<T, P, C, MORE> {
                primitive,
                alpha_max: pass.blending.alpha_max,
                grid,
                tile,
                list: lists.of_tile(tile),
                records,
                attributes: Attributes {
                    features: pass.blending.features,
                    per_view: *per_view,
                    statistics: pass.statistics,
                },
                background: background(picture / groups),
                cotangents: pass.cotangents.of_picture(picture, pixels, channels),
                blended: &planes[tile * per_tile..][..per_tile],
                sums: EntrySums { moments: sums.moments, features: sums.features },
            });
        });
    }

    /// Gradients of primitive `n` of view `v`, after [`backward`](Self::backward): the `N` sums of its shape
    /// ([`Response::backward`], [`Response::SUMS`]), the gradients with respect to its color, and to the depth of its
    /// record.
    pub fn sums<const N: usize>(&self, v: usize, n: usize) -> ([T; N], [T; 3], T) {
        let mut sums = [T::ZERO; LANES];
        for row in self.entries(v, n) {
            sums.iter_mut().zip(row).for_each(|(sum, x)| *sum += *x);
        }
        let shape = std::array::from_fn(|i| sums[i]);
        (shape, std::array::from_fn(|i| sums[N + moment::COLOR + i]), sums[N + moment::DEPTH])
    }
}

/// Differentiates the windows of a tile; fills its part of the sums.
struct BackwardTile<'a, T, P, const C: usize, const MORE: bool> {
    primitive: &'a P,
    alpha_max: f64,
    grid: &'a Grid,
    tile: usize,
    list: &'a [AtomicU32],
    records: &'a [Record<T>],
    attributes: Attributes<'a, T>,
    background: [T; 3],
    cotangents: PictureCotangents<'a, T>,
    /// State after the forward pass, of all windows.
    blended: &'a [Plane<T>],
    sums: EntrySums<'a, T>,
}

impl<T: Real, P: Footprint + Response, const C: usize, const MORE: bool> LaneKernel<T>
    for BackwardTile<'_, T, P, C, MORE>
{
    /// The gradient with respect to the background.
    type Output = [T; 3];

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> [T; 3] {
        self.sums.moments.fill(Row::default());
        self.sums.features.fill(T::ZERO);
        let per_window = self.blended.len() / windows_per_tile(self.grid);
        let channels = self.attributes.features.map_or(0, |features| features.channels);
        let count = 1 + C + channels;
        // Features are rare, and then the work is not in these few allocations.
        let (mut few, mut many) = ([[Row([T::ZERO; LANES]); LANES]; 5], Vec::new());
        let planes = if count <= few.len() { &mut few[..count] } else { grown(&mut many, count) };
        let mut row_sums = vec![Row::default(); channels];
        let mut transmittance = [Row::default(); LANES];
        let mut dbackground = [T::ZERO; 3];
        for (i, window) in windows_of(self.grid, self.tile) {
            let blended = &self.blended[i * per_window..][..per_window];
            let d = prepare::<V>(&window, C == 4, self.background, &self.cotangents, blended, planes);
            (0..3).for_each(|c| dbackground[c] += d[c]);
            let sums = EntrySums { moments: &mut *self.sums.moments, features: &mut *self.sums.features };
            let Self { primitive, alpha_max, attributes, list, records, .. } = self;
            let row_sums = &mut row_sums[..];
            let mut visitor =
                BlendBackward::<V::Part, P, C, MORE>::new(primitive, alpha_max, attributes, planes, sums, row_sums);
            traverse::<V, P>(primitive, alpha_max, &window, list, records, &mut transmittance, &mut visitor);
        }
        dbackground
    }
}

/// Something with a part for each list entry, or for each tile.
pub(crate) trait TileParts: Send + Sized {
    /// The parts of the first `tiles` tiles, which have `entries` entries, and of the rest.
    fn cut(self, tiles: usize, entries: usize) -> (Self, Self);
}

impl<T: Send> TileParts for &mut [Row<T>] {
    fn cut(self, _tiles: usize, entries: usize) -> (Self, Self) {
        self.split_at_mut(entries)
    }
}

/// Sums of the backward pass for each entry and each tile.
struct Sums<'a, T> {
    moments: &'a mut [Row<T>],
    features: &'a mut [T],
    channels: usize,
    background: &'a mut [[T; 3]],
}

impl<T: Send> TileParts for Sums<'_, T> {
    fn cut(self, tiles: usize, entries: usize) -> (Self, Self) {
        let channels = self.channels;
        let (a, b) = self.moments.split_at_mut(entries);
        let (c, d) = self.features.split_at_mut(entries * channels);
        let (e, f) = self.background.split_at_mut(tiles);
        (
            Self { moments: a, features: c, channels, background: e },
            Self { moments: b, features: d, channels, background: f },
        )
    }
}

/// Runs `body` on each tile of a range with the tile's part of the sums, in parallel.
pub(crate) fn for_tiles<P: TileParts>(lists: &Lists, tiles: Range<usize>, parts: P, body: &(dyn Fn(usize, P) + Sync)) {
    match tiles.len() {
        0 => {}
        1 => body(tiles.start, parts),
        count => {
            let middle = tiles.start + count / 2;
            let entries = lists.range(middle).start - lists.range(tiles.start).start;
            let (a, b) = parts.cut(count / 2, entries);
            rayon::join(
                || for_tiles(lists, tiles.start..middle, a, body),
                || for_tiles(lists, middle..tiles.end, b, body),
            );
        }
    }
}
