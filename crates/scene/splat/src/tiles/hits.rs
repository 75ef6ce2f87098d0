//! The blended primitives, hit by hit.

use super::backward::for_tiles;
use super::coverage::CHUNK;
use super::primitive::{Footprint, Response};
use super::traverse::{Hit, Visitor, traverse};
use super::window::{Window, windows_of};
use super::{Record, Tiles};
use crate::memory::grown;
use std::sync::atomic::AtomicU32;
use weaver_kernels::lanes::{self, LANES, LaneKernel, LaneMask, Lanes, Row, Vector};
use weaver_kernels::{Real, parallel};

impl<T: Real> Tiles<T> {
    /// Calls `visit(pixel, primitive, weight, transmittance)` for every primitive at every pixel that it adds to.
    ///
    /// `pixel` indexes `[V, h, w]` of the region, `primitive` is 0 to N - 1, `transmittance` T is the light that
    /// arrives there, `weight` is alpha T, the same numbers that the images are made of. At each pixel hits come front
    /// to back. Tiles are visited in parallel, so that hits of different pixels come in no fixed order.
    pub fn for_each_hit<P: Footprint + Response>(
        &self,
        primitive: &P,
        alpha_max: f64,
        visit: impl Fn(usize, usize, T, T) + Sync,
    ) {
        let Self { grid, lists, records, per_view, .. } = self;
        parallel::for_ranges(self.tiles(), 1, |tiles| {
            for tile in tiles {
                let list = lists.of_tile(tile);
                let first = tile / grid.tiles() * grid.region.pixels();
                for (_, window) in windows_of(grid, tile) {
                    let place = (first, window, *per_view);
                    lanes::run(Report { primitive, alpha_max, place, list, records, visit: &visit });
                }
            }
        });
    }

    /// Contribution of each primitive to the images: the sum and the largest of its weights alpha T over the pixels,
    /// `[V, N]` each; 0 where it is not seen.
    ///
    /// # Panics
    ///
    /// If the lengths are not V N.
    #[inline(never)]
    pub fn contributions<P: Footprint + Response>(
        &mut self,
        primitive: &P,
        alpha_max: f64,
        sums: &mut [T],
        largest: &mut [T],
    ) {
        let tiles = self.tiles();
        let Self { grid, lists, moments, records, per_view, views, .. } = self;
        assert!(
            [sums.len(), largest.len()] == [*views * *per_view; 2],
            "contributions: one number per view and primitive"
        );
        let rows = grown(moments, lists.len());
        for_tiles(lists, 0..tiles, rows, &|tile, rows: &mut [Row<T>]| {
            rows.fill(Row::default());
            for (_, window) in windows_of(grid, tile) {
                let list = lists.of_tile(tile);
                lanes::run(Tally { primitive, alpha_max, window, list, records, rows });
            }
        });
        self.of_primitives(sums, largest, T::max);
    }

    /// Two numbers of each primitive, `[V, N]` each, from those of its entries: sums, and what `join` makes of the
    /// second ones.
    pub(super) fn of_primitives(&self, sums: &mut [T], seconds: &mut [T], join: impl Fn(T, T) -> T + Sync) {
        let per_view = self.per_view;
        parallel::for_chunks2(sums, CHUNK, seconds, CHUNK, |chunk, sums, seconds| {
            for (i, (sum, second)) in sums.iter_mut().zip(seconds).enumerate() {
                let (v, n) = ((chunk * CHUNK + i) / per_view, (chunk * CHUNK + i) % per_view);
                (*sum, *second) = (T::ZERO, T::ZERO);
                for row in self.entries(v, n) {
                    *sum += row[0];
                    *second = join(*second, row[1]);
                }
            }
        });
    }
}

/// Reports every hit in a window.
struct Report<'a, T, P, F> {
    primitive: &'a P,
    alpha_max: f64,
    /// First pixel of the view, window, primitives per view.
    place: (usize, Window, usize),
    list: &'a [AtomicU32],
    records: &'a [Record<T>],
    visit: &'a F,
}

struct Reporter<'a, F> {
    place: (usize, Window, usize),
    current: usize,
    visit: &'a F,
}

impl<V: Vector, R: Response, F: Fn(usize, usize, V::Scalar, V::Scalar)> Visitor<V, R> for Reporter<'_, F> {
    #[inline(always)]
    fn begin(&mut self, primitive: usize, _record: &[V::Scalar; LANES]) {
        self.current = primitive % self.place.2;
    }

    #[inline(always)]
    fn hit(&mut self, hit: &Hit<V, R::Sample<V>>) {
        let (first, window, _) = &self.place;
        let (weight, transmittance) = (hit.weight.to_array(), hit.transmittance.to_array());
        let mut todo = hit.seen.bits();
        while todo != 0 {
            let lane = todo.trailing_zeros() as usize;
            todo &= todo - 1;
            // Only pixels of the region are seen.
            let place = window.pixel(hit.cell.block::<V>(), hit.cell.part::<V>() * V::WIDTH + lane);
            if let Some(pixel) = window.index(place) {
                (self.visit)(first + pixel, self.current, weight[lane], transmittance[lane]);
            }
        }
    }

    fn end(&mut self, _place: usize) {}
}

impl<T: Real, P: Footprint + Response, F: Fn(usize, usize, T, T)> LaneKernel<T> for Report<'_, T, P, F> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let mut reporter = Reporter { place: self.place, current: 0, visit: self.visit };
        let mut left = [Row([T::ZERO; LANES]); LANES];
        let Self { primitive, alpha_max, list, records, .. } = self;
        traverse::<V, P>(primitive, alpha_max, &self.place.1, list, records, &mut left, &mut reporter);
    }
}

/// Sums the weights of the primitives of a window.
struct Tally<'a, T, P> {
    primitive: &'a P,
    alpha_max: f64,
    window: Window,
    list: &'a [AtomicU32],
    records: &'a [Record<T>],
    /// Sum and largest weight of the tile's entries.
    rows: &'a mut [Row<T>],
}

struct Tallier<'a, V: Vector> {
    sum: V,
    largest: V,
    rows: &'a mut [Row<V::Scalar>],
}

impl<V: Vector, R: Response> Visitor<V, R> for Tallier<'_, V> {
    #[inline(always)]
    fn begin(&mut self, _primitive: usize, _record: &[V::Scalar; LANES]) {
        (self.sum, self.largest) = (V::zero(), V::zero());
    }

    #[inline(always)]
    fn hit(&mut self, hit: &Hit<V, R::Sample<V>>) {
        self.sum = self.sum + hit.weight;
        self.largest = self.largest.max(hit.weight);
    }

    #[inline(always)]
    fn end(&mut self, place: usize) {
        let row = &mut self.rows[place].0;
        row[0] += self.sum.to_array().into_iter().sum::<V::Scalar>();
        row[1] = self.largest.to_array().into_iter().fold(row[1], V::Scalar::max);
    }
}

impl<T: Real, P: Footprint + Response> LaneKernel<T> for Tally<'_, T, P> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let mut tallier = Tallier::<V::Part> { sum: V::Part::zero(), largest: V::Part::zero(), rows: self.rows };
        let mut left = [Row([T::ZERO; LANES]); LANES];
        let Self { primitive, alpha_max, window, list, records, .. } = self;
        traverse::<V, P>(primitive, alpha_max, &window, list, records, &mut left, &mut tallier);
    }
}
