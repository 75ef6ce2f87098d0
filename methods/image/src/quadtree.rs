//! Cells of a picture, small where its colors vary.

use crate::picture::Picture;
use crate::window::Window;
use weaver_kernels::subdivision::subdivide;

/// A cell of a picture, and its mean color.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leaf {
    /// Its pixels.
    pub cell: Window,
    /// Mean color.
    pub mean: [f32; 3],
    /// Squared deviation from the mean, summed over pixels and channels.
    pub deviation: f64,
}

/// Divides a picture into `count` cells, or into pixels if there are fewer.
///
/// The cell of the largest squared deviation is halved across its longer side, a square in the direction with the
/// smaller remaining deviation, until there are enough. If no cell has a deviation, the largest is halved. Sums are
/// exact, of colors in 65536 steps.
///
/// ```
/// use weaver_image::{Picture, quadtree};
/// let mut colors = vec![0.0; 8 * 4 * 3];
/// colors[..3].fill(1.0);
/// let leaves = quadtree(&Picture::new(8, 4, colors)?, 6);
/// // The bright corner ends in a cell of its own.
/// assert_eq!(leaves.iter().map(|leaf| leaf.deviation).sum::<f64>(), 0.0);
/// # Ok::<(), weaver_image::ImageError>(())
/// ```
pub fn quadtree(picture: &Picture, count: usize) -> Vec<Leaf> {
    let sums = Sums::new(picture);
    // Deviations are not negative, so that the order of their bits is theirs.
    let worst = |leaf: &Leaf| (leaf.deviation.to_bits(), leaf.cell.pixels());
    subdivide(vec![sums.leaf(picture.window())], count, 2, worst, |leaf| sums.halves(leaf.cell).into_iter().flatten())
}

/// Steps of a color.
const STEPS: f32 = 65535.0;

/// Sums over the pixels above and left of each corner: of red, green, blue, and all squares.
struct Sums {
    corners: Vec<[u64; 4]>,
    width: usize,
}

impl Sums {
    fn new(picture: &Picture) -> Self {
        let width = picture.width + 1;
        let mut corners = vec![[0; 4]; width * (picture.height + 1)];
        for (y, line) in picture.colors.chunks_exact(3 * picture.width).enumerate() {
            let mut row = [0; 4];
            for (x, pixel) in line.chunks_exact(3).enumerate() {
                for (c, color) in pixel.iter().enumerate() {
                    let steps = (color * STEPS).round() as u64;
                    row[c] += steps;
                    row[3] += steps * steps;
                }
                let above = corners[y * width + x + 1];
                corners[(y + 1) * width + x + 1] = std::array::from_fn(|k| above[k] + row[k]);
            }
        }
        Self { corners, width }
    }

    fn leaf(&self, cell: Window) -> Leaf {
        let at = |x: usize, y: usize| self.corners[y * self.width + x];
        let (right, below) = (cell.x + cell.width, cell.y + cell.height);
        let (all, corner, left, above) = (at(right, below), at(cell.x, cell.y), at(cell.x, below), at(right, cell.y));
        let sum: [u64; 4] = std::array::from_fn(|k| all[k] + corner[k] - left[k] - above[k]);
        let pixels = cell.pixels() as u128;
        let squares: u128 = sum[..3].iter().map(|x| u128::from(*x) * u128::from(*x)).sum();
        // Exact up to here, so that a constant cell has no deviation at all.
        let deviation = pixels * u128::from(sum[3]) - squares;
        let steps = f64::from(STEPS);
        Leaf {
            cell,
            mean: std::array::from_fn(|c| (sum[c] as f64 / (pixels as f64 * steps)) as f32),
            deviation: deviation as f64 / (pixels as f64 * steps * steps),
        }
    }

    /// The halves of a cell, unless it is a pixel.
    fn halves(&self, cell: Window) -> Option<[Leaf; 2]> {
        let columns = || {
            let width = cell.width / 2;
            let second = Window { x: cell.x + width, width: cell.width - width, ..cell };
            [self.leaf(Window { width, ..cell }), self.leaf(second)]
        };
        let rows = || {
            let height = cell.height / 2;
            let second = Window { y: cell.y + height, height: cell.height - height, ..cell };
            [self.leaf(Window { height, ..cell }), self.leaf(second)]
        };
        let left = |halves: &[Leaf; 2]| halves[0].deviation + halves[1].deviation;
        match cell.width.cmp(&cell.height) {
            _ if cell.pixels() == 1 => None,
            std::cmp::Ordering::Greater => Some(columns()),
            std::cmp::Ordering::Less => Some(rows()),
            std::cmp::Ordering::Equal => {
                let (columns, rows) = (columns(), rows());
                Some(if left(&rows) < left(&columns) { rows } else { columns })
            }
        }
    }
}
