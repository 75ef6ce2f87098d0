//! Pixels gathered into primitives, by their weights or the squares of these.

use super::backward::{TileParts, for_tiles};
use super::coverage::CHUNK;
use super::primitive::{Footprint, Response};
use super::traverse::{Hit, Visitor, traverse};
use super::window::{Cell, MOST_CELLS, Window, windows_of};
use super::{Record, Tiles};
use crate::columns::prefetch_rows;
use crate::gradients::{Target, put};
use crate::memory::grown;
use std::sync::atomic::AtomicU32;
use weaver_kernels::lanes::{self, LANES, LaneKernel, Lanes, Row, Vector};
use weaver_kernels::{Real, parallel};
use weaver_scene::Features;

impl<T: Real> Tiles<T> {
    /// The sums over all pixels of w times `values` `[V, h, w, channels]`, w = alpha T, for each primitive, `[N,
    /// channels]`: the gradients with respect to features, by the bits of [`backward`](Self::backward), without the
    /// other gradients.
    ///
    /// # Panics
    ///
    /// If a length does not fit.
    #[inline(never)]
    pub fn feature_gradients<P: Footprint + Response>(
        &mut self,
        primitive: &P,
        alpha_max: f64,
        values: Features<'_, T>,
        sums: Target<'_, T>,
    ) {
        self.gather::<P, false>(primitive, alpha_max, values, sums);
    }

    /// The sums over all pixels of w^2 times `values` `[V, h, w, channels]`, w = alpha T, for each primitive, `[N,
    /// channels]`.
    ///
    /// Entries are summed in the order of views and tiles, so that the bits are the same at any number of threads.
    ///
    /// # Panics
    ///
    /// If a length does not fit.
    #[inline(never)]
    pub fn squared_contributions<P: Footprint + Response>(
        &mut self,
        primitive: &P,
        alpha_max: f64,
        values: Features<'_, T>,
        sums: Target<'_, T>,
    ) {
        self.gather::<P, true>(primitive, alpha_max, values, sums);
    }

    fn gather<P: Footprint + Response, const SQUARED: bool>(
        &mut self,
        primitive: &P,
        alpha_max: f64,
        Features { values, channels }: Features<'_, T>,
        sums: Target<'_, T>,
    ) {
        let tiles = self.tiles();
        let Self { grid, lists, feature_sums, records, .. } = self;
        let pixels = grid.region.pixels();
        assert_eq!(values.len(), tiles / grid.tiles() * pixels * channels, "gathering: values of each pixel");
        let parts = Entries { sums: grown(feature_sums, lists.len() * channels), channels };
        for_tiles(lists, 0..tiles, parts, &|tile, Entries { sums, .. }| {
            sums.fill(T::ZERO);
            let picture = tile / grid.tiles();
            let values = &values[picture * pixels * channels..][..pixels * channels];
            let list = lists.of_tile(tile);
            for (_, window) in windows_of(grid, tile) {
                let values = (values, channels);
                lanes::run(Gather::<T, P, SQUARED> { primitive, alpha_max, window, list, records, values, sums });
            }
        });
        self.sum_features(sums, channels);
    }

    /// Sums features over the entries of each primitive, `[N, channels]`; 0 for sums that are not finite.
    ///
    /// # Panics
    ///
    /// If the length does not fit.
    pub(crate) fn sum_features(&self, target: Target<'_, T>, channels: usize) {
        assert_eq!(target.values.len(), self.per_view * channels, "sums of features of each primitive");
        /// Number of primitives ahead whose rows are fetched, which are anywhere in memory.
        const AHEAD: usize = 4;
        let (add, channels) = (target.add, channels.max(1));
        let rows = |n: usize| (0..self.views).flat_map(move |v| self.feature_entries(v, n, channels));
        parallel::for_chunks(target.values, CHUNK * channels, |chunk, out| {
            let end = chunk * CHUNK + out.len() / channels;
            for (i, out) in out.chunks_exact_mut(channels).enumerate() {
                let n = chunk * CHUNK + i;
                if n + AHEAD < end {
                    rows(n + AHEAD).for_each(|row| prefetch_rows(row, 0, channels));
                }
                // Most of a large scene is not in a view: nothing of it is touched.
                if add && rows(n).next().is_none() {
                    continue;
                }
                for (block, out) in out.chunks_mut(LANES).enumerate() {
                    let mut sums = [T::ZERO; LANES];
                    for row in rows(n) {
                        sums.iter_mut().zip(&row[block * LANES..]).for_each(|(sum, x)| *sum += *x);
                    }
                    out.iter_mut().zip(sums).for_each(|(out, sum)| put(out, add, sum));
                }
            }
        });
    }
}

/// A row of sums for each list entry.
struct Entries<'a, T> {
    sums: &'a mut [T],
    channels: usize,
}

impl<T: Send> TileParts for Entries<'_, T> {
    fn cut(self, _tiles: usize, entries: usize) -> (Self, Self) {
        let channels = self.channels;
        let (a, b) = self.sums.split_at_mut(entries * channels);
        (Self { sums: a, channels }, Self { sums: b, channels })
    }
}

/// Gathers the pixels of a window.
struct Gather<'a, T, P, const SQUARED: bool> {
    primitive: &'a P,
    alpha_max: f64,
    window: Window,
    list: &'a [AtomicU32],
    records: &'a [Record<T>],
    /// Of the view, `[h, w, channels]`.
    values: (&'a [T], usize),
    /// Of the tile's entries, `[entries, channels]`.
    sums: &'a mut [T],
}

struct Gatherer<'a, V: Vector, const SQUARED: bool> {
    /// Of the window, `[blocks, channels]`.
    values: &'a [Row<V::Scalar>],
    channels: usize,
    /// Cells that a primitive met, and its weights there.
    met: [(Cell, V); MOST_CELLS],
    count: usize,
    sums: &'a mut [V::Scalar],
}

impl<V: Vector, const SQUARED: bool> Gatherer<'_, V, SQUARED> {
    /// The products of the weights with channels from `first` on, summed over cells.
    #[inline(always)]
    fn products<const N: usize>(&self, first: usize) -> [V; N] {
        let mut sums = [V::zero(); N];
        for (cell, weight) in &self.met[..self.count] {
            let rows = &self.values[cell.block::<V>() * self.channels + first..][..N];
            for (sum, row) in sums.iter_mut().zip(rows) {
                *sum = weight.mul_add(V::load_part(&row.0, cell.part::<V>()), *sum);
            }
        }
        sums
    }
}

impl<V: Vector, R: Response, const SQUARED: bool> Visitor<V, R> for Gatherer<'_, V, SQUARED> {
    #[inline(always)]
    fn begin(&mut self, _primitive: usize, _record: &[V::Scalar; LANES]) {
        self.count = 0;
    }

    #[inline(always)]
    fn hit(&mut self, hit: &Hit<V, R::Sample<V>>) {
        let weight = if SQUARED { hit.weight * hit.weight } else { hit.weight };
        self.met[self.count % MOST_CELLS] = (hit.cell, weight);
        self.count += 1;
    }

    #[inline(always)]
    fn end(&mut self, place: usize) {
        // Sixteen channels stay in registers while cells pass.
        for first in (0..self.channels).step_by(LANES) {
            let width = LANES.min(self.channels - first);
            let mut rows = [V::zero(); LANES];
            if width == LANES {
                rows = self.products(first);
            } else {
                for (c, row) in rows.iter_mut().enumerate().take(width) {
                    [*row] = self.products(first + c);
                }
            }
            let totals = &mut self.sums[place * self.channels + first..][..width];
            let mut sums = [V::Scalar::ZERO; LANES];
            V::add_sums(&rows, &mut sums);
            totals.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
        }
    }
}

impl<T: Real, P: Footprint + Response, const SQUARED: bool> LaneKernel<T> for Gather<'_, T, P, SQUARED> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let Self { primitive, alpha_max, window, list, records, values: (values, channels), sums } = self;
        let mut planes = vec![Row([T::ZERO; LANES]); LANES * channels];
        for (block, rows) in planes.chunks_exact_mut(channels.max(1)).enumerate() {
            window.gather_all::<V>(block, values, rows);
        }
        let met = [(Cell::default(), V::Part::zero()); MOST_CELLS];
        let mut gatherer = Gatherer::<V::Part, SQUARED> { values: &planes, channels, met, count: 0, sums };
        let mut left = [Row([T::ZERO; LANES]); LANES];
        traverse::<V, P>(primitive, alpha_max, &window, list, records, &mut left, &mut gatherer);
    }
}
