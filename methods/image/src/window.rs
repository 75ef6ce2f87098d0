//! The drawn part of a picture, and pictures cut into tiles.

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

    /// The part of a picture that enters a drawing of this window at another size: `factor` as in
    /// [`Gaussians::at_scale`](crate::Gaussians::at_scale), Gaussians that end at `cut` standard deviations.
    pub fn around(&self, factor: f64, cut: f64) -> Self {
        // Upper bound on the filter's addition to a standard deviation.
        let wider = cut * ((1.0 - factor * factor).max(0.0) / 12.0).sqrt() / factor + 1.0;
        let along = |first: usize, length: usize| {
            let low = (first as f64 / factor - wider).floor().max(0.0);
            let high = (first.saturating_add(length) as f64 / factor + wider).ceil();
            (low as usize, (high - low) as usize)
        };
        let ((x, width), (y, height)) = (along(self.x, self.width), along(self.y, self.height));
        Self { x, y, width, height }
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

    /// Tiles that meet the window, along x and y. They are the picture's, so that a pixel is computed alike in all
    /// windows.
    pub(crate) fn tiles(&self) -> [usize; 2] {
        [(self.x, self.width), (self.y, self.height)]
            .map(|(first, length)| (first + length).div_ceil(TILE) - first / TILE)
    }

    /// First pixel of a tile, in the picture.
    pub(crate) fn corner(&self, tile: usize) -> [usize; 2] {
        let columns = self.tiles()[0];
        [(self.x / TILE + tile % columns) * TILE, (self.y / TILE + tile / columns) * TILE]
    }

    /// The part of a tile that lies in the window.
    pub(crate) fn inside(&self, tile: usize) -> Inside {
        let [x, y] = self.corner(tile);
        Inside {
            first: [self.x.saturating_sub(x), self.y.saturating_sub(y)],
            end: [(self.x + self.width - x).min(TILE), (self.y + self.height - y).min(TILE)],
            place: [x.max(self.x) - self.x, y.max(self.y) - self.y],
        }
    }

    /// Cuts an image of `channels` numbers a pixel into the lines of each row of tiles.
    pub(crate) fn bands<'a, T>(&self, image: &'a mut [T], channels: usize) -> Vec<&'a mut [T]> {
        let stride = channels * self.width;
        let before = (TILE - self.y % TILE).min(self.height);
        let (first, rest) = image.split_at_mut(before * stride);
        std::iter::once(first).chain(rest.chunks_mut((TILE * stride).max(1))).collect()
    }
}

/// The part of a tile that lies in a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Inside {
    /// First column and row.
    pub first: [usize; 2],
    /// Column and row behind the last.
    pub end: [usize; 2],
    /// Place of the first column and row in the window.
    pub place: [usize; 2],
}

impl Inside {
    /// True for the whole tile.
    #[inline(always)]
    pub fn is_whole(&self) -> bool {
        self.first == [0; 2] && self.end == [TILE; 2]
    }
}

/// The pixels of a tile, block by block, for each channel.
pub(crate) type Planes<T, const C: usize> = [[Row<T>; LANES]; C];

/// Planes of zeros.
#[inline(always)]
pub(crate) fn zeros<T: Real, const C: usize>() -> Planes<T, C> {
    [[Row([T::ZERO; LANES]); LANES]; C]
}

/// The pixels of a tile in an image of lines of `stride` numbers, zeros outside.
#[inline(always)]
pub(crate) fn to_planes<T: Real, const C: usize>(image: &[T], stride: usize, inside: Inside) -> Planes<T, C> {
    let mut planes = zeros();
    let ([x0, y0], [x1, y1]) = (inside.first, inside.end);
    for (y, row) in (y0..y1).zip(inside.place[1]..) {
        let line = &image[row * stride + C * inside.place[0]..][..C * (x1 - x0)];
        for (x, pixel) in (x0..x1).zip(line.chunks_exact(C)) {
            for c in 0..C {
                planes[c][y / BLOCK * BLOCKS + x / BLOCK].0[y % BLOCK * BLOCK + x % BLOCK] = pixel[c];
            }
        }
    }
    planes
}

/// Copies planes to pixels, the inverse of [`to_planes`]; `lines` is the row of tiles.
#[inline(always)]
pub(crate) fn from_planes<T: Real, const C: usize>(
    planes: &Planes<T, C>,
    lines: &mut [T],
    stride: usize,
    inside: Inside,
) {
    let ([x0, y0], [x1, y1]) = (inside.first, inside.end);
    for (row, y) in (y0..y1).enumerate() {
        let line = &mut lines[row * stride + C * inside.place[0]..][..C * (x1 - x0)];
        for (x, pixel) in (x0..x1).zip(line.chunks_exact_mut(C)) {
            for c in 0..C {
                pixel[c] = planes[c][y / BLOCK * BLOCKS + x / BLOCK].0[y % BLOCK * BLOCK + x % BLOCK];
            }
        }
    }
}

/// A picture cut into tiles, as input of a fit's steps.
#[derive(Clone, Debug)]
pub struct Tiled<T> {
    pub(crate) window: Window,
    pub(crate) tiles: Vec<Planes<T, 3>>,
}

impl<T: Real> Tiled<T> {
    /// Cuts a picture `[H, W, 3]`; sides that are no multiples of 16 are padded by pixels that do not count.
    ///
    /// # Errors
    /// Another number of values.
    pub fn new(image: &[T], width: usize, height: usize) -> Result<Self, ImageError> {
        expect_len("picture", image.len(), 3 * width * height)?;
        let window = Window::whole(width, height);
        window.check()?;
        let [columns, rows] = window.tiles();
        let tiles = (0..columns * rows).map(|tile| to_planes(image, 3 * width, window.inside(tile))).collect();
        Ok(Self { window, tiles })
    }

    /// Columns and rows of the picture.
    pub fn size(&self) -> [usize; 2] {
        [self.window.width, self.window.height]
    }
}
