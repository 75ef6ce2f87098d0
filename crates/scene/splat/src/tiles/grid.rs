//! The tiles of an image, and the part of the image that is drawn.

use std::ops::Range;

/// A rectangle of pixels of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// The leftmost column.
    pub x: usize,
    /// The topmost row.
    pub y: usize,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
}

impl Region {
    /// A whole image.
    pub fn whole(width: usize, height: usize) -> Self {
        Self { x: 0, y: 0, width, height }
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// True if it has pixels, all of them in an image of this size.
    pub fn is_within(&self, width: usize, height: usize) -> bool {
        let fits =
            |start: usize, len: usize, limit: usize| len > 0 && start.checked_add(len).is_some_and(|end| end <= limit);
        fits(self.x, self.width, width) && fits(self.y, self.height, height)
    }

    /// The first column and row, and those behind the last.
    pub(crate) fn bounds(&self) -> [Range<usize>; 2] {
        [self.x..self.x + self.width, self.y..self.y + self.height]
    }
}

/// Side of a tile, the square of pixels that shares one list of primitives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TileSide {
    /// 16 pixels.
    Sixteen,
    /// 32 pixels.
    ThirtyTwo,
    /// 64 pixels.
    SixtyFour,
}

impl TileSide {
    /// The side in pixels.
    pub fn pixels(self) -> usize {
        match self {
            TileSide::Sixteen => 16,
            TileSide::ThirtyTwo => 32,
            TileSide::SixtyFour => 64,
        }
    }
}

/// The tiles that meet a region of an image.
///
/// Tiles divide the whole image, for any region: a pixel belongs to one tile and to one place in it, so that sums over
/// the pixels of a tile have the same order with and without a region.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    pub(crate) region: Region,
    /// Pixels per tile side.
    pub(crate) side: usize,
    /// Column and row of the first tile in the whole image.
    first: [u32; 2],
    /// Numbers of columns and rows.
    count: [u32; 2],
}

impl Grid {
    /// The tiles of `side` over `region`.
    pub fn new(region: Region, side: TileSide) -> Self {
        let side = side.pixels();
        let first = region.bounds().map(|range| (range.start / side) as u32);
        let end = region.bounds().map(|range| range.end.div_ceil(side) as u32);
        Self { region, side, first, count: [end[0] - first[0], end[1] - first[1]] }
    }

    /// Number of tiles.
    pub fn tiles(&self) -> usize {
        self.count[0] as usize * self.count[1] as usize
    }

    /// The region that the tiles cover.
    pub fn region(&self) -> Region {
        self.region
    }

    /// The tile in a column and a row of the whole image.
    #[inline(always)]
    pub(crate) fn tile(&self, column: u32, row: u32) -> u32 {
        (row - self.first[1]) * self.count[0] + (column - self.first[0])
    }

    /// Left and top pixel of tile `t`.
    pub(crate) fn corner(&self, t: usize) -> (usize, usize) {
        let columns = self.count[0] as usize;
        let (column, row) = (self.first[0] as usize + t % columns, self.first[1] as usize + t / columns);
        (column * self.side, row * self.side)
    }

    /// The columns (axis 0) or rows (axis 1) of tiles, numbered in the whole image, with a pixel center in `[low,
    /// high]`.
    #[inline(always)]
    pub(crate) fn touched(&self, axis: usize, low: f64, high: f64) -> Range<u32> {
        let side = self.side as f64;
        // Casts saturate, and NaN becomes 0.
        let start = ((low - side + 0.5) / side).ceil() as u32;
        let end = ((high - 0.5) / side + 1.0).floor() as u32;
        start.max(self.first[axis])..end.min(self.first[axis] + self.count[axis])
    }
}
