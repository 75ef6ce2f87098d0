//! Cells of photos, small where color or depth varies.

use crate::agreement::Map;
use crate::picture::Picture;
use std::cmp::Reverse;
use weaver_kernels::subdivision::subdivide;

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
/// Error of a cell beside the error of its colors, over the square of the number of its pixels: large ones are divided
/// even where they are plain.
const PLAIN: f64 = 1e-4 / 16.0;

/// A square of a photo.
#[derive(Clone, Copy)]
struct Square {
    photo: usize,
    x: usize,
    y: usize,
    side: usize,
}

/// A square with owned pixels.
struct Node {
    square: Square,
    sums: Sums,
    /// In the order in which squares were made: of equal ones the first is divided first.
    number: usize,
}

/// Owned pixels of a square: their number, the sums of colors, places and logarithms of inverse depth, and of the
/// squares of colors and logarithms.
#[derive(Default)]
struct Sums {
    pixels: f64,
    color: [f64; 3],
    place: [f64; 2],
    log_w: f64,
    squares: f64,
}

/// At most `count` cells of the owned pixels: the square that is worst described by one color and one depth is divided
/// until there are enough.
pub(crate) fn cells(pictures: &[Picture], maps: &[Map], owned: &[Vec<bool>], count: usize) -> Vec<Cell> {
    let view = View { pictures, maps, owned };
    let mut made = 0;
    let mut node = |square| {
        let sums = view.sums(&square);
        made += 1;
        (sums.pixels > 0.0).then_some(Node { square, sums, number: made })
    };
    let mut roots = Vec::new();
    for (photo, Picture { camera, .. }) in pictures.iter().enumerate() {
        for y in (0..camera.height).step_by(SIDE) {
            roots.extend((0..camera.width).step_by(SIDE).filter_map(|x| node(Square { photo, x, y, side: SIDE })));
        }
    }
    // Errors are not negative, so that their bits are in their order.
    let worst = |node: &Node| (node.sums.error().to_bits(), Reverse(node.number));
    let mut nodes = subdivide(roots, count, 4, worst, |divided| {
        divided.square.quarters().into_iter().filter_map(&mut node).collect::<Vec<_>>()
    });
    nodes.sort_unstable_by_key(|node| node.number);
    nodes.truncate(count);
    nodes.iter().map(|node| view.cell(node)).collect()
}

impl Square {
    /// Its quarters, none of a pixel.
    fn quarters(self) -> Vec<Self> {
        let Self { photo, x, y, side } = self;
        let half = side / 2;
        let corners = [(x, y), (x + half, y), (x, y + half), (x + half, y + half)];
        let corners = corners.into_iter().filter(|_| half > 0);
        corners.map(|(x, y)| Self { photo, x, y, side: half }).collect()
    }
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

    fn cell(&self, Node { square, sums, .. }: &Node) -> Cell {
        let Sums { pixels, color, place, .. } = sums;
        let width = self.pictures[square.photo].camera.width;
        let away = |at: &usize| {
            (at % width).abs_diff((place[0] / pixels).round() as usize).pow(2)
                + (at / width).abs_diff((place[1] / pixels).round() as usize).pow(2)
        };
        let at = self.pixels(square).min_by_key(away).expect("squares without pixels are left out");
        Cell { photo: square.photo, at, pixels: *pixels as usize, color: color.map(|c| (c / pixels) as f32) }
    }
}

impl Sums {
    /// Squared deviations from the mean, and a little for plain cells.
    fn error(&self) -> f64 {
        let means = self.color.iter().map(|c| c * c).sum::<f64>() + self.log_w * self.log_w;
        (self.squares - means / self.pixels).max(0.0) + PLAIN * self.pixels * self.pixels
    }
}
