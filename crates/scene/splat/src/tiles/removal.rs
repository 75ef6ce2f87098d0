//! What images would be without each primitive alone.

use super::backward::for_tiles;
use super::blend::values;
use super::primitive::{Footprint, Response};
use super::traverse::{Hit, Visitor, traverse};
use super::window::{Plane, windows_of};
use super::{Grid, Record, Tiles};
use crate::memory::grown;
use std::sync::atomic::AtomicU32;
use weaver_kernels::Real;
use weaver_kernels::lanes::{self, LANES, LaneKernel, Lanes, Row, Vector};

/// Images beside what they should be.
#[derive(Clone, Copy, Debug)]
pub struct Compared<'a, T> {
    /// The images that were drawn, `[V, H, W, 3]`.
    pub image: &'a [T],
    /// Their difference from what they should be, `[V, H, W, 3]`.
    pub error: &'a [T],
    /// Weights of the pixels, `[V, H, W]`.
    pub counts: &'a [T],
    /// A linear map of colors before they are compared, row by row.
    pub map: [T; 9],
}

impl<T: Real> Tiles<T> {
    /// Rise of the weighted squared error of the images without each primitive alone, and the sum of its weights
    /// alpha T over pixels that count, `[V, N]` each; 0 where it is not seen.
    ///
    /// # Panics
    ///
    /// If the lengths are not V N.
    #[inline(never)]
    pub fn removal<P: Footprint + Response>(
        &mut self,
        primitive: &P,
        alpha_max: f64,
        compared: &Compared<'_, T>,
        rises: &mut [T],
        shown: &mut [T],
    ) {
        let tiles = self.tiles();
        let Self { grid, lists, moments, records, .. } = self;
        let pixels = grid.region.pixels();
        let rows = grown(moments, lists.len());
        for_tiles(lists, 0..tiles, rows, &|tile, rows: &mut [Row<T>]| {
            rows.fill(Row::default());
            let first = tile / grid.tiles() * pixels;
            let compared = Compared {
                image: &compared.image[3 * first..][..3 * pixels],
                error: &compared.error[3 * first..][..3 * pixels],
                counts: &compared.counts[first..][..pixels],
                ..*compared
            };
            let list = lists.of_tile(tile);
            lanes::run(RemoveTile { primitive, alpha_max, compared, grid, tile, list, records, rows });
        });
        self.of_primitives(rises, shown, |of, row| of + row);
    }
}

/// Sums the rises of the primitives of a tile.
struct RemoveTile<'a, T, P> {
    primitive: &'a P,
    alpha_max: f64,
    compared: Compared<'a, T>,
    grid: &'a Grid,
    tile: usize,
    list: &'a [AtomicU32],
    records: &'a [Record<T>],
    /// Rise and sum of weights of the tile's entries.
    rows: &'a mut [Row<T>],
}

/// A pixel shows `C = sum_i w_i c_i + T b`, and is `e` beside what it should be. Without primitive i it changes by `d =
/// alpha / (1 - alpha) rest_i - w_i c_i`, where `rest_i` is the part of C from behind it; the squared error rises by `A
/// d (2 e + A d)`.
struct Remove<'a, V: Vector> {
    map: [V; 9],
    /// All that comes from behind the primitives so far.
    rest: &'a mut [Plane<V::Scalar>; 3],
    error: &'a [Plane<V::Scalar>; 3],
    counts: &'a Plane<V::Scalar>,
    /// The primitive's color.
    color: [V; 3],
    rise: V,
    shown: V,
    rows: &'a mut [Row<V::Scalar>],
}

impl<V: Vector, R: Response> Visitor<V, R> for Remove<'_, V> {
    #[inline(always)]
    fn begin(&mut self, _primitive: usize, record: &[V::Scalar; LANES]) {
        self.color = values(record);
        (self.rise, self.shown) = (V::zero(), V::zero());
    }

    #[inline(always)]
    fn hit(&mut self, hit: &Hit<V, R::Sample<V>>) {
        let Hit { cell, seen, alpha, weight, .. } = hit;
        let odds = (*alpha * (V::constant(1.0) - *alpha).recip()).only(*seen);
        let mut change = [V::zero(); 3];
        for (change, (color, plane)) in change.iter_mut().zip(self.color.iter().zip(self.rest.iter_mut())) {
            let rest = weight.neg_mul_add(*color, cell.load(plane));
            cell.store(rest, plane);
            *change = weight.neg_mul_add(*color, odds * rest);
        }
        let mut rise = V::zero();
        for c in 0..3 {
            let [x, y, z] = [0, 1, 2].map(|k| self.map[3 * c + k]);
            let change = x.mul_add(change[0], y.mul_add(change[1], z * change[2]));
            let error: V = cell.load(&self.error[c]);
            rise = change.mul_add(error + error + change, rise);
        }
        let counts: V = cell.load(self.counts);
        self.rise = counts.mul_add(rise, self.rise);
        self.shown = counts.mul_add(*weight, self.shown);
    }

    #[inline(always)]
    fn end(&mut self, place: usize) {
        let row = &mut self.rows[place].0;
        row[0] += self.rise.to_array().into_iter().sum::<V::Scalar>();
        row[1] += self.shown.to_array().into_iter().sum::<V::Scalar>();
    }
}

impl<T: Real, P: Footprint + Response> LaneKernel<T> for RemoveTile<'_, T, P> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let Self { primitive, alpha_max, compared, list, records, rows, .. } = self;
        let zero = [Row([T::ZERO; LANES]); LANES];
        let (mut rest, mut error, mut counts, mut left) = ([zero; 3], [zero; 3], zero, zero);
        for (_, window) in windows_of(self.grid, self.tile) {
            for block in 0..LANES {
                for c in 0..3 {
                    window.gather::<V>(block, compared.image, 3, c).store(&mut rest[c][block].0);
                    window.gather::<V>(block, compared.error, 3, c).store(&mut error[c][block].0);
                }
                window.gather::<V>(block, compared.counts, 1, 0).store(&mut counts[block].0);
            }
            let zero = V::Part::zero();
            let mut remove = Remove::<V::Part> {
                map: compared.map.map(V::Part::splat),
                rest: &mut rest,
                error: &error,
                counts: &counts,
                color: [zero; 3],
                rise: zero,
                shown: zero,
                rows,
            };
            traverse::<V, P>(primitive, alpha_max, &window, list, records, &mut left, &mut remove);
        }
    }
}
