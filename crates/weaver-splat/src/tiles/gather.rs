//! Pixels gathered into primitives by the squares of their weights.

use super::backward::{TileParts, for_tiles};
use super::coverage::CHUNK;
use super::primitive::{Footprint, Response};
use super::traverse::{Hit, Visitor, traverse};
use super::window::{Plane, Window, windows_of};
use super::{Record, Tiles};
use crate::gradients::Target;
use crate::memory::grown;
use std::sync::atomic::AtomicU32;
use weaver_kernels::lanes::{self, LANES, LaneKernel, Lanes, Row};
use weaver_kernels::{Real, parallel};

impl<T: Real> Tiles<T> {
    /// The sums over all pixels of w^2 times `values` `[V, h, w, channels]`, w = alpha T, for each primitive, `[N, channels]`.
    ///
    /// Entries are summed in the order of views and tiles, so that the bits are the same at any number of threads.
    ///
    /// # Panics
    ///
    /// If a length does not fit.
    pub fn squared_contributions<P: Footprint + Response>(
        &mut self,
        primitive: &P,
        alpha_max: f64,
        (values, channels): (&[T], usize),
        sums: Target<'_, T>,
    ) {
        let (tiles, per_view) = (self.tiles(), self.per_view);
        let Self { grid, lists, feature_sums, records, views, .. } = self;
        let pixels = grid.region.pixels();
        assert_eq!(values.len(), *views * pixels * channels, "squared contributions: values of each pixel");
        assert_eq!(sums.values.len(), per_view * channels, "squared contributions: sums of each primitive");
        let parts = Entries { sums: grown(feature_sums, lists.len() * channels), channels };
        for_tiles(lists, 0..tiles, parts, &|tile, Entries { sums, .. }| {
            sums.fill(T::ZERO);
            let view = tile / grid.tiles();
            let values = &values[view * pixels * channels..][..pixels * channels];
            let list = lists.of_tile(tile);
            for (_, window) in windows_of(grid, tile) {
                let values = (values, channels);
                lanes::run(Gather { primitive, alpha_max, window, list, records, values, sums });
            }
        });
        let (add, views) = (sums.add, self.views);
        parallel::for_chunks(sums.values, CHUNK * channels.max(1), |chunk, out| {
            for (i, out) in out.chunks_exact_mut(channels).enumerate() {
                if !add {
                    out.fill(T::ZERO);
                }
                for row in (0..views).flat_map(|v| self.feature_entries(v, chunk * CHUNK + i, channels)) {
                    out.iter_mut().zip(row).for_each(|(sum, x)| *sum += *x);
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
struct Gather<'a, T, P> {
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

struct Gatherer<'a, V: Lanes> {
    values: &'a [Plane<V::Scalar>],
    row: Vec<Row<V::Scalar>>,
    sums: &'a mut [V::Scalar],
}

impl<V: Lanes, R: Response> Visitor<V, R> for Gatherer<'_, V> {
    #[inline(always)]
    fn begin(&mut self, _primitive: usize, _record: &[V::Scalar; LANES]) {
        self.row.fill(Row::default());
    }

    #[inline(always)]
    fn hit(&mut self, hit: &Hit<V, R::Sample<V>>) {
        let squared = hit.weight * hit.weight;
        for (plane, sum) in self.values.iter().zip(&mut self.row) {
            squared.mul_add(V::load(&plane[hit.block].0), V::load(&sum.0)).store(&mut sum.0);
        }
    }

    #[inline(always)]
    fn end(&mut self, place: usize) {
        let channels = self.row.len();
        for (total, sum) in self.sums[place * channels..][..channels].iter_mut().zip(&self.row) {
            *total += sum.0.iter().copied().sum::<V::Scalar>();
        }
    }
}

impl<T: Real, P: Footprint + Response> LaneKernel<T> for Gather<'_, T, P> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let Self { primitive, alpha_max, window, list, records, values: (values, channels), sums } = self;
        let mut planes = vec![[Row([T::ZERO; LANES]); LANES]; channels];
        for (channel, plane) in planes.iter_mut().enumerate() {
            for (block, row) in plane.iter_mut().enumerate() {
                window.gather::<V>(block, values, channels, channel).store(&mut row.0);
            }
        }
        let mut gatherer = Gatherer::<V> { values: &planes, row: vec![Row::default(); channels], sums };
        let mut left = [Row([T::ZERO; LANES]); LANES];
        traverse::<V, P>(primitive, alpha_max, &window, list, records, &mut left, &mut gatherer);
    }
}
