//! Passes over a row of tiles.

use crate::lists::Lists;
use crate::tile::{Sums, Tile, Values, residual};
use crate::window::{Tiled, Window, from_planes, to_planes, zeros};
use std::ops::Range;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LaneKernel, Lanes, Row};

/// Gaussians as a linear map from their colors to pixels.
#[derive(Clone, Copy)]
pub struct Rays<'a, T> {
    pub window: Window,
    pub lists: &'a Lists,
    pub records: &'a [Row<T>],
    pub cut: T,
}

impl<'a, T: Real> Rays<'a, T> {
    /// Tiles of a row.
    #[inline(always)]
    fn tiles(&self, band: usize) -> Range<usize> {
        band * self.lists.tiles[0]..(band + 1) * self.lists.tiles[0]
    }

    #[inline(always)]
    fn tile(&self, tile: usize) -> Tile<'a, T> {
        let ids = &self.lists.entries[self.lists.of_tile(tile)];
        Tile { corner: self.window.corner(tile), ids, records: self.records, cut: self.cut }
    }

    /// The range of a tile's entries within its row.
    #[inline(always)]
    fn own(&self, band: usize, tile: usize) -> Range<usize> {
        let (all, first) = (self.lists.of_tile(tile), self.lists.of_band(band).start);
        all.start - first..all.end - first
    }
}

/// Draws a row of tiles.
pub struct Draw<'a, T, const C: usize> {
    pub rays: Rays<'a, T>,
    pub band: usize,
    pub colors: &'a [T],
    pub lines: &'a mut [T],
}

impl<T: Real, const C: usize> LaneKernel<T> for Draw<'_, T, C> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let Self { rays, band, colors, lines } = self;
        let mut kept = Values::default();
        for tile in rays.tiles(band) {
            let mut planes = zeros();
            rays.tile(tile).draw::<V, C, false>(colors, &mut planes, &mut kept);
            from_planes(&planes, lines, C * rays.window.width, rays.window.inside(tile));
        }
    }
}

/// Passes the gradient of an image back, for a row of tiles.
pub struct Transposed<'a, T, const C: usize, const MOVE: bool> {
    pub rays: Rays<'a, T>,
    pub band: usize,
    pub colors: &'a [T],
    /// Gradient with respect to the whole image.
    pub slopes: &'a [T],
    pub sums: &'a mut [Sums<T>],
}

impl<T: Real, const C: usize, const MOVE: bool> LaneKernel<T> for Transposed<'_, T, C, MOVE> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let Self { rays, band, colors, slopes, sums } = self;
        let stride = C * rays.window.width;
        let mut kept = Values::default();
        for tile in rays.tiles(band) {
            let planes = to_planes(slopes, stride, rays.window.inside(tile));
            let own = rays.own(band, tile);
            let here = rays.tile(tile);
            here.draw::<V, 0, true>(&[], &mut [], &mut kept);
            here.sums::<V, C, MOVE>(colors, &planes, &kept, &mut sums[own]);
        }
    }
}

/// Draws a row of tiles, compares them with a picture and passes the gradient of the squared error back; returns the
/// sum of squares. The gradients are half the derivatives of the sum.
pub struct Step<'a, T> {
    pub rays: Rays<'a, T>,
    pub band: usize,
    pub colors: &'a [T],
    pub target: &'a Tiled<T>,
    pub sums: &'a mut [Sums<T>],
}

impl<T: Real> LaneKernel<T> for Step<'_, T> {
    type Output = f64;

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> f64 {
        let Self { rays, band, colors, target, sums } = self;
        let mut kept = Values::default();
        let mut error = 0.0;
        for tile in rays.tiles(band) {
            let mut planes = zeros();
            let here = rays.tile(tile);
            here.draw::<V, 3, true>(colors, &mut planes, &mut kept);
            error += residual::<V>(&mut planes, &target.tiles[tile], rays.window.inside(tile));
            here.sums::<V, 3, true>(colors, &planes, &kept, &mut sums[rays.own(band, tile)]);
        }
        error
    }
}

/// Counts the pairs of a Gaussian and a block of its footprint over a row of tiles.
pub struct Count<'a, T> {
    pub rays: Rays<'a, T>,
    pub band: usize,
}

impl<T: Real> LaneKernel<T> for Count<'_, T> {
    type Output = u64;

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> u64 {
        self.rays.tiles(self.band).map(|tile| self.rays.tile(tile).blocks::<V>()).sum()
    }
}
