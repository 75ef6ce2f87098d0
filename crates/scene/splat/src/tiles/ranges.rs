//! Depths of primitives along the rays of pixels, beyond their blended sum: median and distortion.

use super::assemble::WindowPlanes;
use super::primitive::{Footprint, Response};
use super::record;
use super::traverse::{Hit, Visitor, traverse};
use super::window::{Plane, windows_of, windows_per_tile};
use super::{Grid, Record, Tiles};
use crate::memory::grown;
use std::sync::atomic::AtomicU32;
use weaver_kernels::lanes::{self, LANES, LaneKernel, Lanes, Row, Vector};
use weaver_kernels::{Real, parallel};

/// Planes of a window: median, distortion, sum w z, sum w z^2.
const PLANES: usize = 4;

impl<T: Real> Tiles<T> {
    /// Writes the median depth and the distortion of each pixel of the lists, `[V, h, w]` each.
    ///
    /// The median is the depth z ([`Response::depth`]) of the last primitive that more than half of the light reaches,
    /// 0 without any. The distortion is the sum of w_i w_j (z_i - z_j)^2 over pairs of primitives, with w = alpha T.
    ///
    /// # Panics
    ///
    /// If a length is not V h w.
    #[inline(never)]
    pub fn ranges<P: Footprint + Response>(
        &mut self,
        primitive: &P,
        alpha_max: f64,
        median: &mut [T],
        distortion: &mut [T],
    ) {
        let pixels = self.views * self.groups * self.grid.region.pixels();
        assert!([median.len(), distortion.len()] == [pixels; 2], "ranges: one number for each pixel");
        let tiles = self.tiles();
        let Self { grid, lists, records, range_planes, .. } = self;
        let per_tile = windows_per_tile(grid) * PLANES;
        let planes = grown(range_planes, tiles * per_tile);
        parallel::for_chunks(planes, per_tile, |tile, planes| {
            let list = lists.of_tile(tile);
            lanes::run(RangesOfTile { primitive, alpha_max, grid, tile, list, records, planes });
        });
        let windows = WindowPlanes { planes: &self.range_planes, per_window: PLANES };
        for (plane, out) in [median, distortion].into_iter().enumerate() {
            self.assemble(out, windows, 1, |_, window, block, lane, out| {
                out.copy_from_slice(&window[plane][block].0[lane..][..out.len()]);
            });
        }
    }
}

/// Walks the windows of a tile.
struct RangesOfTile<'a, T, P> {
    primitive: &'a P,
    alpha_max: f64,
    grid: &'a Grid,
    tile: usize,
    list: &'a [AtomicU32],
    records: &'a [Record<T>],
    /// Of all windows.
    planes: &'a mut [Plane<T>],
}

impl<T: Real, P: Footprint + Response> LaneKernel<T> for RangesOfTile<'_, T, P> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let Self { primitive, alpha_max, grid, tile, list, records, planes } = self;
        let mut left = [Row::default(); LANES];
        for (i, window) in windows_of(grid, tile) {
            let planes = planes[i * PLANES..].first_chunk_mut::<PLANES>().expect("planes of each window");
            planes.as_flattened_mut().fill(Row::default());
            let mut visitor = Ranges::<V::Part, P> { primitive, center: V::Part::zero(), planes };
            traverse::<V, P>(primitive, alpha_max, &window, list, records, &mut left, &mut visitor);
        }
    }
}

/// Follows depths front to back.
struct Ranges<'a, V: Vector, R> {
    primitive: &'a R,
    /// Depth of the record at hand.
    center: V,
    planes: &'a mut [Plane<V::Scalar>; PLANES],
}

impl<V: Vector, R: Response> Visitor<V, R> for Ranges<'_, V, R> {
    #[inline(always)]
    fn begin(&mut self, _primitive: usize, record: &[V::Scalar; LANES]) {
        self.center = V::splat(record[record::DEPTH]);
    }

    #[inline(always)]
    fn hit(&mut self, hit: &Hit<V, R::Sample<V>>) {
        let z = self.primitive.depth(&hit.sample, self.center);
        let (cell, [median, distortion, first, second]) = (hit.cell, self.planes.each_mut());
        let more_than_half = hit.transmittance.gt_among(V::constant(0.5), hit.seen);
        cell.store(z.or(more_than_half, cell.load(median)), median);
        let (m1, m2): (V, V) = (cell.load(first), cell.load(second));
        let before = V::constant(1.0) - hit.transmittance;
        let spread = z * z * before + m2 - V::constant(2.0) * z * m1;
        cell.store(hit.weight.mul_add(spread, cell.load(distortion)), distortion);
        cell.store(hit.weight.mul_add(z, m1), first);
        cell.store(hit.weight.mul_add(z * z, m2), second);
    }

    #[inline(always)]
    fn end(&mut self, _place: usize) {}
}
