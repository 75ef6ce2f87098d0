//! Cells of photos, small where color or depth varies.

use crate::agreement::Map;
use crate::picture::Picture;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// A cell of a photo.
#[derive(Clone, Debug)]
pub(crate) struct Cell {
    /// The photo.
    pub photo: usize,
    /// The pixel of the cell that is nearest to the middle of its pixels.
    pub at: usize,
    /// Number of its pixels.
    pub pixels: usize,
    /// Their mean color.
    pub color: [f32; 3],
}

/// Side of the cells in the beginning, pixels.
const SIDE: usize = 16;
/// Error of a cell beside that of its colors, over the square of the number of its pixels: large ones are divided even where they are plain.
const PLAIN: f64 = 1e-4 / 16.0;

/// A square that may be divided.
struct Square {
    photo: usize,
    x: usize,
    y: usize,
    side: usize,
}

/// Owned pixels of a square: their number, the sums of colors, places and logarithms of inverse depth, and of the squares of colors and logarithms.
#[derive(Default)]
struct Sums {
    pixels: f64,
    color: [f64; 3],
    place: [f64; 2],
    log_w: f64,
    squares: f64,
}

/// At most `count` cells of the owned pixels: the square that is worst described by one color and one depth is divided until there are enough.
pub(crate) fn cells(pictures: &[Picture], maps: &[Map], owned: &[Vec<bool>], count: usize) -> Vec<Cell> {
    let view = View { pictures, maps, owned };
    let mut squares: Vec<Square> = Vec::new();
    let mut open = BinaryHeap::new();
    let add = |squares: &mut Vec<Square>, open: &mut BinaryHeap<_>, square: Square| {
        let sums = view.sums(&square);
        if sums.pixels > 0.0 {
            // Errors are not negative, so that their bits are in their order.
            open.push((sums.error().to_bits(), Reverse(squares.len())));
            squares.push(square);
        }
    };
    for (photo, picture) in pictures.iter().enumerate() {
        for y in (0..picture.camera.height).step_by(SIDE) {
            for x in (0..picture.camera.width).step_by(SIDE) {
                add(&mut squares, &mut open, Square { photo, x, y, side: SIDE });
            }
        }
    }
    // Three more than one that is divided, at most.
    let mut done: Vec<usize> = Vec::new();
    while open.len() + done.len() + 3 <= count {
        let Some((_, Reverse(n))) = open.pop() else { break };
        let Square { photo, x, y, side } = squares[n];
        if side == 1 {
            done.push(n);
            continue;
        }
        let half = side / 2;
        for (x, y) in [(x, y), (x + half, y), (x, y + half), (x + half, y + half)] {
            add(&mut squares, &mut open, Square { photo, x, y, side: half });
        }
    }
    done.extend(open.into_iter().map(|(_, Reverse(n))| n));
    done.sort_unstable();
    done.truncate(count);
    done.into_iter().map(|n| view.cell(&squares[n])).collect()
}

struct View<'a> {
    pictures: &'a [Picture],
    maps: &'a [Map],
    owned: &'a [Vec<bool>],
}

impl View<'_> {
    /// The owned pixels of a square.
    fn pixels(&self, square: &Square) -> impl Iterator<Item = usize> {
        let camera = &self.pictures[square.photo].camera;
        let (width, owned) = (camera.width, &self.owned[square.photo]);
        let columns = square.x..(square.x + square.side).min(width);
        let rows = square.y..(square.y + square.side).min(camera.height);
        rows.flat_map(move |y| columns.clone().map(move |x| y * width + x)).filter(|at| owned[*at])
    }

    fn sums(&self, square: &Square) -> Sums {
        let (picture, map) = (&self.pictures[square.photo], &self.maps[square.photo]);
        let mut sums = Sums::default();
        for at in self.pixels(square) {
            let color = picture.colors[at].map(|c| f64::from(c) / 255.0);
            let log_w = f64::from(map.w[at]).ln();
            sums.pixels += 1.0;
            (0..3).for_each(|c| sums.color[c] += color[c]);
            sums.place[0] += (at % picture.camera.width) as f64;
            sums.place[1] += (at / picture.camera.width) as f64;
            sums.log_w += log_w;
            sums.squares += color.iter().map(|c| c * c).sum::<f64>() + log_w * log_w;
        }
        sums
    }

    fn cell(&self, square: &Square) -> Cell {
        let Sums { pixels, color, place, .. } = self.sums(square);
        let width = self.pictures[square.photo].camera.width;
        let away = |at: &usize| {
            (at % width).abs_diff((place[0] / pixels).round() as usize).pow(2)
                + (at / width).abs_diff((place[1] / pixels).round() as usize).pow(2)
        };
        let at = self.pixels(square).min_by_key(away).expect("squares without pixels are left out");
        Cell { photo: square.photo, at, pixels: pixels as usize, color: color.map(|c| (c / pixels) as f32) }
    }
}

impl Sums {
    /// Squared deviations from the mean, and a little for what is plain.
    fn error(&self) -> f64 {
        let means = self.color.iter().map(|c| c * c).sum::<f64>() + self.log_w * self.log_w;
        (self.squares - means / self.pixels).max(0.0) + PLAIN * self.pixels * self.pixels
    }
}
