//! Lists of the Gaussians that meet each tile.

use crate::error::ImageError;
use crate::record::TILE;
use crate::window::Window;
use std::ops::Range;

/// The most entries of all lists.
const MOST: usize = 1 << 30;

/// The Gaussians over each tile of a window, in their own order.
#[derive(Clone, Debug, Default)]
pub struct Lists {
    /// Tiles along x and y.
    pub tiles: [usize; 2],
    /// The first entry of each tile, and the end.
    starts: Vec<usize>,
    /// Gaussians, tile after tile.
    pub entries: Vec<u32>,
    /// The entries of each Gaussian, Gaussian after Gaussian.
    places: Vec<u32>,
    /// The first of the places of each Gaussian, and the end.
    firsts: Vec<usize>,
    /// The tiles over each Gaussian: first column, column behind the last, rows alike.
    pub boxes: Vec<[u32; 4]>,
}

impl Lists {
    /// Fills the lists from the [`boxes`](Self::boxes), computed by [`over`] for this window.
    pub fn fill(&mut self, window: &Window) -> Result<(), ImageError> {
        self.tiles = window.tiles();
        let [columns, rows] = self.tiles;
        self.firsts.clear();
        self.starts.clear();
        self.starts.resize(columns * rows + 1, 0);
        let mut total = 0;
        for [x0, x1, y0, y1] in self.boxes.iter().copied() {
            self.firsts.push(total);
            total += (x1 - x0) as usize * (y1 - y0) as usize;
            if total > MOST {
                return Err(ImageError::TooMany { most: MOST, found: total });
            }
            for y in y0..y1 {
                (x0..x1).for_each(|x| self.starts[y as usize * columns + x as usize] += 1);
            }
        }
        self.firsts.push(total);
        let mut sum = 0;
        for start in &mut self.starts {
            (*start, sum) = (sum, sum + *start);
        }
        self.entries.resize(total, 0);
        self.places.clear();
        for (i, [x0, x1, y0, y1]) in self.boxes.iter().copied().enumerate() {
            for y in y0..y1 {
                for x in x0..x1 {
                    let next = &mut self.starts[y as usize * columns + x as usize];
                    self.entries[*next] = i as u32;
                    self.places.push(*next as u32);
                    *next += 1;
                }
            }
        }
        // Each start has moved to the end of its tile, which is the start of the next.
        self.starts.rotate_right(1);
        self.starts[0] = 0;
        Ok(())
    }

    /// The entries of a tile.
    pub fn of_tile(&self, tile: usize) -> Range<usize> {
        self.starts[tile]..self.starts[tile + 1]
    }

    /// The entries of a row of tiles.
    pub fn of_band(&self, band: usize) -> Range<usize> {
        self.starts[band * self.tiles[0]]..self.starts[(band + 1) * self.tiles[0]]
    }

    /// The places of a Gaussian's entries among all entries.
    pub fn of_gaussian(&self, i: usize) -> &[u32] {
        &self.places[self.firsts[i]..self.firsts[i + 1]]
    }
}

/// The tiles of a window that meet a box, given by its middle and half its sides, in pixels.
pub fn over(window: &Window, center: [f64; 2], half: [f64; 2]) -> [u32; 4] {
    let tiles = window.tiles();
    let along = |axis: usize, first: usize| {
        let tiles = tiles[axis] as u32;
        let center = center[axis] - (first / TILE * TILE) as f64;
        // Middles of pixels lie half a pixel inside a tile; the hundredth of a pixel allows for rounding.
        let low = ((center - half[axis] - 0.01 - (TILE as f64 - 0.5)) / TILE as f64).ceil().max(0.0) as u32;
        let high = ((center + half[axis] + 0.01 - 0.5) / TILE as f64).floor() + 1.0;
        [low.min(tiles), (high.max(0.0) as u32).clamp(low.min(tiles), tiles)]
    };
    let ([x0, x1], [y0, y1]) = (along(0, window.x), along(1, window.y));
    [x0, x1, y0, y1]
}
