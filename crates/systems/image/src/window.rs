//! The part of a picture that is drawn, and pictures cut into tiles.

use crate::error::{ImageError, expect_len, range};
use crate::record::{BLOCK, BLOCKS, TILE};
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, Row};

/// The most pixels of a drawing.
const MOST: usize = 1 << 28;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Window {
    /// A whole picture.
    pub fn whole(width: usize, height: usize) -> Self {
        Self { x: 0, y: 0, width, height }
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// Checks that there are pixels, and not more than are drawn at once.
    pub(crate) fn check(&self) -> Result<(), ImageError> {
        let pixels = self.width.checked_mul(self.height).filter(|n| (1..=MOST).contains(n));
        let far = self.x.max(self.y).checked_add(self.width.max(self.height)).filter(|end| *end <= MOST);
        match pixels.and(far) {
            Some(_) => Ok(()),
            None => Err(range("pixels of a drawing", format!("1 to {MOST}"), format!("{self:?}"))),
        }
    }

    pub(crate) fn tiles(&self) -> [usize; 2] {
        [self.width.div_ceil(TILE), self.height.div_ceil(TILE)]
    }

    /// First pixel of a tile, in the picture.
    pub(crate) fn corner(&self, tile: usize) -> [usize; 2] {
        let columns = self.tiles()[0];
        [self.x + tile % columns * TILE, self.y + tile / columns * TILE]
    }

    /// Pixels of a tile that lie in the window, columns and rows.
    pub(crate) fn inside(&self, tile: usize) -> [usize; 2] {
        let [x, y] = self.corner(tile);
        [(self.x + self.width - x).min(TILE), (self.y + self.height - y).min(TILE)]
    }
}

/// The pixels of a tile, block by block, for each channel.
pub(crate) type Planes<T, const C: usize> = [[Row<T>; LANES]; C];

/// Planes of zeros.
#[inline(always)]
pub(crate) fn zeros<T: Real, const C: usize>() -> Planes<T, C> {
    [[Row([T::ZERO; LANES]); LANES]; C]
}

/// Copies pixels to planes, zeros outside; `lines` begins with the first pixel of the tile in an image of lines of `stride` numbers.
#[inline(always)]
pub(crate) fn to_planes<T: Real, const C: usize>(
    lines: &[T],
    stride: usize,
    [width, height]: [usize; 2],
    planes: &mut Planes<T, C>,
) {
    if width < TILE || height < TILE {
        *planes = zeros();
    }
    for y in 0..height {
        let line = &lines[y * stride..][..C * width];
        for (x, pixel) in line.chunks_exact(C).enumerate() {
            for c in 0..C {
                planes[c][y / BLOCK * BLOCKS + x / BLOCK].0[y % BLOCK * BLOCK + x % BLOCK] = pixel[c];
            }
        }
    }
}

/// Copies planes to pixels, as [`to_planes`] the other way.
#[inline(always)]
pub(crate) fn from_planes<T: Real, const C: usize>(
    planes: &Planes<T, C>,
    lines: &mut [T],
    stride: usize,
    [width, height]: [usize; 2],
) {
    for y in 0..height {
        let line = &mut lines[y * stride..][..C * width];
        for (x, pixel) in line.chunks_exact_mut(C).enumerate() {
            for c in 0..C {
                pixel[c] = planes[c][y / BLOCK * BLOCKS + x / BLOCK].0[y % BLOCK * BLOCK + x % BLOCK];
            }
        }
    }
}

/// A picture cut into tiles, as a step of a fit reads it.
#[derive(Clone, Debug)]
pub struct Tiled<T> {
    pub(crate) window: Window,
    pub(crate) tiles: Vec<Planes<T, 3>>,
}

impl<T: Real> Tiled<T> {
    /// Cuts a picture `[H, W, 3]`; sides that are no multiples of 16 are padded by pixels that do not count.
    ///
    /// # Errors
    /// Another number of numbers.
    pub fn new(image: &[T], width: usize, height: usize) -> Result<Self, ImageError> {
        expect_len("picture", image.len(), 3 * width * height)?;
        let window = Window::whole(width, height);
        window.check()?;
        let [columns, rows] = window.tiles();
        let mut tiles = vec![zeros(); columns * rows];
        for (tile, planes) in tiles.iter_mut().enumerate() {
            let [x, y] = window.corner(tile);
            to_planes(&image[3 * (y * width + x)..], 3 * width, window.inside(tile), planes);
        }
        Ok(Self { window, tiles })
    }

    /// Columns and rows of the picture.
    pub fn size(&self) -> [usize; 2] {
        [self.window.width, self.window.height]
    }
}
