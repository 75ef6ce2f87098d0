//! One tile: Gaussians to pixels, and pixels back to sums for each Gaussian.

use crate::record::{BLOCK, BLOCKS, Grid, Loaded, value};
use crate::window::{Inside, Planes};
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, LaneMask, Lanes, Row};

/// Sums over pixels for a Gaussian in a tile: three of colors, then t u, t v, t u u, t u v, t v v.
pub type Sums<T> = [T; SUMS];
/// Number of sums.
pub const SUMS: usize = 8;
/// Place of the first sum of the shape.
pub const SHAPE: usize = 3;

/// The Gaussians over a tile.
#[derive(Clone, Copy)]
pub struct Tile<'a, T> {
    /// First pixel, in the picture.
    pub corner: [usize; 2],
    pub ids: &'a [u32],
    pub records: &'a [Row<T>],
    /// Exponent of two beyond which a value is 0.
    pub cut: T,
}

/// Values of the Gaussians of a tile at its pixels.
#[derive(Clone, Debug, Default)]
pub struct Values<T> {
    /// Blocks of each Gaussian's footprint.
    blocks: Vec<u16>,
    /// Values in these blocks, one after another.
    values: Vec<Row<T>>,
}

impl<T: Real> Values<T> {
    /// Reserves memory for a tile with this number of Gaussians.
    fn reserve(&mut self, gaussians: usize, keep: bool) {
        if self.blocks.len() < gaussians {
            self.blocks.resize(gaussians, 0);
        }
        if keep && self.values.len() < gaussians * LANES {
            self.values.resize(gaussians * LANES, Row([T::ZERO; LANES]));
        }
    }
}

impl<T: Real> Tile<'_, T> {
    /// Pairs of a Gaussian and a block of its footprint.
    #[inline(always)]
    pub fn blocks<V: Lanes<Scalar = T>>(&self) -> u64 {
        let (grid, cut) = (Grid::<V>::new(self.corner), V::splat(self.cut));
        let mut sum = 0;
        for id in self.ids {
            sum += u64::from(Loaded::<V>::new(&self.records[*id as usize]).blocks(&grid, cut).count_ones());
        }
        sum
    }

    /// Adds the Gaussians' colors `[N, C]` to planes. With `KEEP`, their values are kept, for [`sums`](Self::sums).
    #[inline(always)]
    pub fn draw<V: Lanes<Scalar = T>, const C: usize, const KEEP: bool>(
        &self,
        colors: &[T],
        planes: &mut Planes<T, C>,
        kept: &mut Values<T>,
    ) {
        let grid = Grid::<V>::new(self.corner);
        let cut = V::splat(self.cut);
        kept.reserve(self.ids.len(), KEEP);
        // Blocks are found before the loop over them, whose length cannot be predicted.
        for (blocks, id) in kept.blocks.iter_mut().zip(self.ids) {
            *blocks = Loaded::<V>::new(&self.records[*id as usize]).blocks(&grid, cut);
        }
        let mut next = 0;
        for (entry, id) in self.ids.iter().enumerate() {
            let id = *id as usize;
            let gaussian = Loaded::<V>::new(&self.records[id]).over(&grid);
            let mut todo = kept.blocks[entry];
            let mut color = [V::zero(); C];
            for (to, color) in color.iter_mut().zip(&colors[id * C..]) {
                *to = V::splat(*color);
            }
            while todo != 0 {
                let block = todo.trailing_zeros() as usize % LANES;
                todo &= todo - 1;
                let value = value(gaussian.at(block), cut);
                for c in 0..C {
                    let sum = &mut planes[c][block].0;
                    value.mul_add(color[c], V::load(sum)).store(sum);
                }
                if KEEP {
                    value.store(&mut kept.values[next].0);
                    next += 1;
                }
            }
        }
    }

    /// Sums over pixels for each Gaussian, from gradients with respect to planes and kept values: of colors, and with
    /// `MOVE` of the shape, too.
    #[inline(always)]
    pub fn sums<V: Lanes<Scalar = T>, const C: usize, const MOVE: bool>(
        &self,
        colors: &[T],
        slopes: &Planes<T, C>,
        kept: &Values<T>,
        out: &mut [Sums<T>],
    ) {
        let grid = Grid::<V>::new(self.corner);
        let mut next = 0;
        // Two Gaussians share the sums across lanes.
        let mut both = [V::zero(); LANES];
        for (entry, id) in self.ids.iter().enumerate() {
            let id = *id as usize;
            let gaussian = Loaded::<V>::new(&self.records[id]).over(&grid);
            let mut sums = [V::zero(); SUMS];
            let mut color = [V::zero(); C];
            if MOVE {
                for (to, color) in color.iter_mut().zip(&colors[id * C..]) {
                    *to = V::splat(*color);
                }
            }
            let mut todo = kept.blocks[entry];
            while todo != 0 {
                let block = todo.trailing_zeros() as usize % LANES;
                todo &= todo - 1;
                let value = V::load(&kept.values[next].0);
                next += 1;
                let mut slope = V::zero();
                for c in 0..C {
                    let plane = V::load(&slopes[c][block].0);
                    sums[c] = value.mul_add(plane, sums[c]);
                    if MOVE {
                        slope = if c == 0 { plane * color[c] } else { plane.mul_add(color[c], slope) };
                    }
                }
                if MOVE {
                    let [u, v] = gaussian.at(block);
                    let t = value * slope;
                    let (tu, tv) = (t * u, t * v);
                    sums[SHAPE] = sums[SHAPE] + tu;
                    sums[SHAPE + 1] = sums[SHAPE + 1] + tv;
                    sums[SHAPE + 2] = tu.mul_add(u, sums[SHAPE + 2]);
                    sums[SHAPE + 3] = tu.mul_add(v, sums[SHAPE + 3]);
                    sums[SHAPE + 4] = tv.mul_add(v, sums[SHAPE + 4]);
                }
            }
            let half = entry % 2 * SUMS;
            both[half..half + SUMS].copy_from_slice(&sums);
            if half > 0 || entry + 1 == self.ids.len() {
                let totals = V::sums(&both).to_array();
                let first = entry - entry % 2;
                for (out, totals) in out[first..=entry].iter_mut().zip(totals.as_chunks::<SUMS>().0) {
                    *out = *totals;
                }
            }
        }
    }
}

/// Subtracts a target from the drawn planes, zeros outside of the picture; returns the sum of squares.
#[inline(always)]
pub fn residual<V: Lanes>(drawn: &mut Planes<V::Scalar, 3>, target: &Planes<V::Scalar, 3>, inside: Inside) -> f64 {
    let mut sum = V::zero();
    for block in 0..LANES {
        let mask = V::Mask::from_bits(lanes_inside(block, inside));
        for c in 0..3 {
            let difference = (V::load(&drawn[c][block].0) - V::load(&target[c][block].0)).only(mask);
            difference.store(&mut drawn[c][block].0);
            sum = difference.mul_add(difference, sum);
        }
    }
    sum.to_array().into_iter().map(|x| x.to_f64()).sum()
}

/// The lanes of a block that lie in the picture.
#[inline(always)]
fn lanes_inside(block: usize, inside: Inside) -> u16 {
    if inside.is_whole() {
        return u16::MAX;
    }
    let corner = [block % BLOCKS * BLOCK, block / BLOCKS * BLOCK];
    let within = |axis: usize, at: usize| (inside.first[axis]..inside.end[axis]).contains(&(corner[axis] + at));
    let lanes = (0..LANES).filter(|lane| within(0, lane % BLOCK) && within(1, lane / BLOCK));
    lanes.fold(0, |bits, lane| bits | 1 << lane)
}
