//! Cells: square blocks of pixels that share Gaussians, and the bands into which the Gaussians of a cell divide it.

use std::ops::Range;
use weaver_autograd::Buffer;

/// The coarsest level of cells: 16 x 16 pixels.
pub const COARSEST: u8 = 4;

/// The cells of an assignment: instead of pixels, square blocks of them get Gaussians.
///
/// Each cell is named by its first pixel (its upper left corner): that is the pixel to which the assignment gives an
/// expert. At other pixels the entries mean nothing.
#[derive(Debug)]
pub struct Cells {
    /// Level of each pixel's cell `[P]`: its side is 2^level pixels.
    pub level: Buffer<u8>,
    /// Direction of the bands of each pixel's cell `[P]`, across which colors change most, in radians from the x axis
    /// to the y axis.
    pub angle: Buffer<f32>,
}

/// A square block of the pixels of a view, as far as they lie inside it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell {
    /// Its first row.
    pub row: usize,
    /// Its first column.
    pub column: usize,
    /// Its side is 2^level pixels.
    pub level: u8,
}

impl Cell {
    /// Side in pixels.
    pub fn side(self) -> usize {
        1 << self.level
    }

    /// Rows of a view of this height.
    pub fn rows(self, height: usize) -> Range<usize> {
        self.row..(self.row + self.side()).min(height)
    }

    /// Columns of a view of this width.
    pub fn columns(self, width: usize) -> Range<usize> {
        self.column..(self.column + self.side()).min(width)
    }

    /// The bands of equal width that divide the cell across a direction.
    pub fn bands(self, count: usize, angle: f32) -> Bands {
        let half = self.side() as f32 / 2.0;
        let across = [angle.cos(), angle.sin()];
        let reach = half * (across[0].abs() + across[1].abs());
        Bands { center: [self.column as f32 + half, self.row as f32 + half], across, reach, count }
    }
}

/// Bands of equal width that divide a cell: one for each of its Gaussians.
#[derive(Clone, Copy, Debug)]
pub struct Bands {
    center: [f32; 2],
    across: [f32; 2],
    reach: f32,
    count: usize,
}

impl Bands {
    /// The band of a pixel; one outside the cell belongs to the band nearest to it.
    pub fn of(&self, row: usize, column: usize) -> usize {
        let [x, y] = [column as f32 + 0.5 - self.center[0], row as f32 + 0.5 - self.center[1]];
        let along = (x * self.across[0] + y * self.across[1] + self.reach) / (2.0 * self.reach);
        ((along * self.count as f32).floor().max(0.0) as usize).min(self.count - 1)
    }

    /// Width of a band in pixels.
    pub fn width(&self) -> f32 {
        2.0 * self.reach / self.count as f32
    }

    /// Where the middle of a band lies across the cell, in pixels from the cell's center.
    pub fn middle(&self, band: usize) -> f32 {
        (band as f32 + 0.5) * self.width() - self.reach
    }
}
