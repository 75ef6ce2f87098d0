//! Windows of 16 x 16 pixels, which are 4 x 4 blocks of 4 x 4 pixels; a block fits in one [`Lanes`].
//!
//! The blocks are worked on in cells of a register each: whole blocks, or their upper and lower halves.

use super::{Grid, Region};
use crate::each::each;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, Lanes, Row, Vector};

/// Pixels per side of a window.
pub(crate) const SIDE: usize = 16;
/// Pixels per side of a block, and blocks per side of a window.
pub(crate) const BLOCK: usize = 4;
/// One number for each pixel of a window, block by block.
pub(crate) type Plane<T> = [Row<T>; LANES];

/// The most parts of a block that are worked on one by one.
pub(crate) const MOST_PARTS: usize = 2;
/// The most cells of a window.
pub(crate) const MOST_CELLS: usize = LANES * MOST_PARTS;

/// A part of a block whose pixels fit in a vector, rows of four one after the other: all parts of a block, then those
/// of the next. Its number is that of the vector in a [`Plane`].
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Cell(pub usize);

impl Cell {
    /// The block.
    #[inline(always)]
    pub fn block<V: Vector>(self) -> usize {
        const { assert!(LANES / V::WIDTH <= MOST_PARTS && V::WIDTH.is_multiple_of(BLOCK)) };
        self.0 / (LANES / V::WIDTH)
    }

    /// Which part of the block.
    #[inline(always)]
    pub fn part<V: Vector>(self) -> usize {
        self.0 % (LANES / V::WIDTH)
    }

    /// The pixels' numbers in a plane.
    #[inline(always)]
    pub fn load<V: Vector>(self, plane: &Plane<V::Scalar>) -> V {
        V::load_nth(plane, self.0)
    }

    /// Sets the pixels' numbers in a plane.
    #[inline(always)]
    pub fn store<V: Vector>(self, x: V, plane: &mut Plane<V::Scalar>) {
        x.store_nth(plane, self.0);
    }
}

/// A window and the region that is drawn, which it may reach beyond.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window {
    /// Left and top pixel in the whole image.
    pub corner: (usize, usize),
    pub region: Region,
}

impl Window {
    /// The pixel (x, y) of a lane of a block in the whole image; outside the region for windows at its edge.
    #[inline(always)]
    pub fn pixel(&self, block: usize, lane: usize) -> (usize, usize) {
        let x = block % BLOCK * BLOCK + lane % BLOCK;
        let y = block / BLOCK * BLOCK + lane / BLOCK;
        (self.corner.0 + x, self.corner.1 + y)
    }

    /// The index within the region of a pixel of the whole image, if it is inside.
    #[inline(always)]
    pub fn index(&self, (x, y): (usize, usize)) -> Option<usize> {
        let Region { x: left, y: top, width, height } = self.region;
        let (x, y) = (x.wrapping_sub(left), y.wrapping_sub(top));
        (x < width && y < height).then(|| y * width + x)
    }

    /// True if it is wholly inside the region.
    fn inside(&self) -> bool {
        let last = (self.corner.0 + SIDE - 1, self.corner.1 + SIDE - 1);
        self.index(self.corner).is_some() && self.index(last).is_some()
    }

    /// The lanes of a block that are in the region.
    pub fn lanes(&self, block: usize) -> u16 {
        if self.inside() {
            return u16::MAX;
        }
        let inside = |lane| self.index(self.pixel(block, lane)).is_some();
        (0..LANES).fold(0, |bits, lane| bits | u16::from(inside(lane)) << lane)
    }

    /// The pixels' centers: x for each column of blocks, y for each row.
    #[inline(always)]
    pub fn centers<V: Lanes>(&self) -> [[Row<V::Scalar>; BLOCK]; 2] {
        let [mut columns, mut rows] = [[Row::default(); BLOCK]; 2];
        for i in 0..BLOCK {
            for lane in 0..LANES {
                let (x, _) = self.pixel(i, lane);
                let (_, y) = self.pixel(i * BLOCK, lane);
                columns[i].0[lane] = V::Scalar::from_f64(x as f64 + 0.5);
                rows[i].0[lane] = V::Scalar::from_f64(y as f64 + 0.5);
            }
        }
        [columns, rows]
    }

    /// A channel of the region's image `[h, w, channels]` at the pixels of a block; 0 beyond its edge.
    #[inline(always)]
    pub fn gather<V: Lanes>(&self, block: usize, image: &[V::Scalar], channels: usize, channel: usize) -> V {
        if self.inside() {
            let (x, y) = self.pixel(block, 0);
            let first = (y - self.region.y) * self.region.width + x - self.region.x;
            let rows = each!(BLOCK, |row| &image[(first + row * self.region.width) * channels..][..BLOCK * channels]);
            return V::from_fn(
                #[inline(always)]
                |lane| rows[lane / BLOCK][lane % BLOCK * channels + channel],
            );
        }
        V::from_fn(|lane| {
            let index = self.index(self.pixel(block, lane));
            index.map_or(V::Scalar::ZERO, |index| image[index * channels + channel])
        })
    }
}

impl Window {
    /// All channels of the region's image `[h, w, channels]` at the pixels of a block, `rows` `[channels]`; 0 beyond
    /// its edge.
    #[inline(always)]
    pub fn gather_all<V: Lanes>(&self, block: usize, image: &[V::Scalar], rows: &mut [Row<V::Scalar>]) {
        let channels = rows.len();
        for (group, rows) in rows.chunks_mut(LANES).enumerate() {
            let first = group * LANES;
            if rows.len() < LANES {
                for (c, row) in rows.iter_mut().enumerate() {
                    self.gather::<V>(block, image, channels, first + c).store(&mut row.0);
                }
                continue;
            }
            // Sixteen channels of each pixel lie together.
            let mut pixels = each!(LANES, |lane| {
                let index = self.index(self.pixel(block, lane));
                match index {
                    Some(index) => V::load(image[index * channels + first..].first_chunk().expect("sixteen channels")),
                    None => V::zero(),
                }
            });
            V::transpose(&mut pixels);
            rows.iter_mut().zip(pixels).for_each(|(row, x)| x.store(&mut row.0));
        }
    }
}

/// The windows of tile `t` (of all views) that meet the region, with their place among the tile's.
pub(crate) fn windows_of(grid: &Grid, t: usize) -> impl Iterator<Item = (usize, Window)> + use<> {
    let (side, region) = (grid.side, grid.region);
    let (x, y) = grid.corner(t % grid.tiles());
    let [columns, rows] = region.bounds();
    let across = side / SIDE;
    (0..across * across).filter_map(move |i| {
        let corner = (x + i % across * SIDE, y + i / across * SIDE);
        let after = corner.0 + SIDE > columns.start && corner.1 + SIDE > rows.start;
        let before = corner.0 < columns.end && corner.1 < rows.end;
        (after && before).then_some((i, Window { corner, region }))
    })
}

/// Windows in a tile.
pub(crate) fn windows_per_tile(grid: &Grid) -> usize {
    (grid.side / SIDE).pow(2)
}
