//! A Gaussian in the form that the drawing of tiles reads.

use crate::gaussians::Gaussians;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, LaneMask, Lanes, Row};

/// Sides of a block of pixels, which fill a vector.
pub const BLOCK: usize = 4;
/// Blocks along a side of a tile.
pub const BLOCKS: usize = 4;
/// Pixels along a side of a tile.
pub const TILE: usize = BLOCK * BLOCKS;
/// Exponents of two by which a block may lie beyond the cut through rounding alone.
const SLACK: f64 = 0.02;

/// `-log2 w` at one standard deviation.
pub const K: f64 = 0.5 * std::f64::consts::LOG2_E;

/// Exponent of two of a Gaussian's value at this number of standard deviations.
pub fn exponent(deviations: f64) -> f64 {
    -K * deviations * deviations
}

/// The record of a Gaussian: center, the factor of its precision, slopes of its ridge lines; and half the sides of the
/// box around its ellipse of one standard deviation.
///
/// `log2 w = -(u^2 + v^2)` with `u = a dx + b dy`, `v = c dy`: the Cholesky factor of the precision, whose squares
/// cannot cancel.
pub fn record<T: Real>(gaussians: &Gaussians<T>, i: usize) -> (Row<T>, [f64; 2]) {
    let [s1, s2] = [gaussians.scales[2 * i], gaussians.scales[2 * i + 1]].map(|s| s.to_f64());
    let (sin, cos) = gaussians.angles[i].to_f64().sin_cos();
    let (p1, p2) = (K / (s1 * s1), K / (s2 * s2));
    let xx = p1 * cos * cos + p2 * sin * sin;
    let yy = p1 * sin * sin + p2 * cos * cos;
    let xy = (p1 - p2) * sin * cos;
    let a = xx.sqrt();
    let numbers = [a, xy / a, K / (s1 * s2 * a), -xy / yy, -xy / xx];
    let mut row = Row([T::ZERO; LANES]);
    row.0[..2].copy_from_slice(&gaussians.centers[2 * i..2 * i + 2]);
    row.0[2..7].iter_mut().zip(numbers).for_each(|(to, x)| *to = T::from_f64(x));
    let half = [[cos, sin], [sin, cos]].map(|[a, b]| ((s1 * a).powi(2) + (s2 * b).powi(2)).sqrt());
    (row, half)
}

/// A record in all lanes.
#[derive(Clone, Copy)]
pub struct Loaded<V> {
    x: V,
    y: V,
    a: V,
    b: V,
    c: V,
    y_by_x: V,
    x_by_y: V,
}

impl<V: Lanes> Loaded<V> {
    #[inline(always)]
    pub fn new(Row(r): &Row<V::Scalar>) -> Self {
        let [x, y, a, b, c, y_by_x, x_by_y, ..] = *r;
        let s = V::splat;
        Self { x: s(x), y: s(y), a: s(a), b: s(b), c: s(c), y_by_x: s(y_by_x), x_by_y: s(x_by_y) }
    }

    /// Base-2 logarithm of the value at an offset from the center.
    #[inline(always)]
    fn log2(&self, [dx, dy]: [V; 2]) -> V {
        log2([self.b.mul_add(dy, self.a * dx), self.c * dy])
    }

    /// The Gaussian over a tile.
    #[inline(always)]
    pub fn over(&self, grid: &Grid<V>) -> Over<V> {
        let [dx, dy] = [grid.x - self.x, grid.y - self.y];
        let mut shifts = [Row([V::Scalar::ZERO; LANES]); 2];
        self.b.mul_add(grid.down, self.a * grid.right).store(&mut shifts[0].0);
        (self.c * grid.down).store(&mut shifts[1].0);
        Over { first: [self.b.mul_add(dy, self.a * dx), self.c * dy], shifts }
    }

    /// The blocks of a tile that meet the ellipse, one bit per block.
    ///
    /// On a rectangle without the center, the largest value lies on one of the two sides that face it.
    #[inline(always)]
    pub fn blocks(&self, grid: &Grid<V>, cut: V) -> u16 {
        let zero = V::zero();
        let far = V::constant((BLOCK - 1) as f64);
        let [x0, y0] = [grid.right - (self.x - grid.corner[0]), grid.down - (self.y - grid.corner[1])];
        let [x1, y1] = [x0 + far, y0 + far];
        let (x, y) = (zero.max(x0).min(x1), zero.max(y0).min(y1));
        let beside = self.log2([x, (self.y_by_x * x).max(y0).min(y1)]);
        let above = self.log2([(self.x_by_y * y).max(x0).min(x1), y]);
        beside.max(above).ge(cut - V::constant(SLACK)).bits()
    }
}

/// A Gaussian over a tile: u and v at the lanes of its first block, and the increments for each block.
pub struct Over<V: Lanes> {
    first: [V; 2],
    shifts: [Row<V::Scalar>; 2],
}

impl<V: Lanes> Over<V> {
    /// u and v at the pixels of a block.
    #[inline(always)]
    pub fn at(&self, block: usize) -> [V; 2] {
        [0, 1].map(
            #[inline(always)]
            |k| self.first[k] + V::splat(self.shifts[k].0[block]),
        )
    }
}

#[inline(always)]
fn log2<V: Lanes>([u, v]: [V; 2]) -> V {
    v.neg_mul_add(v, u.neg_mul_add(u, V::zero()))
}

/// The value at u and v, 0 beyond the cut at the exponent `cut`.
#[inline(always)]
pub fn value<V: Lanes>(uv: [V; 2], cut: V) -> V {
    let e = log2(uv);
    e.exp2().only(e.ge(cut))
}

/// Pixel middles of a tile.
pub struct Grid<V> {
    /// X coordinates of the lanes of the first block.
    x: V,
    y: V,
    /// X and y of the first pixel, in all lanes.
    corner: [V; 2],
    /// Pixels from the first block to each, a lane per block.
    right: V,
    down: V,
}

impl<V: Lanes> Grid<V> {
    #[inline(always)]
    pub fn new(corner: [usize; 2]) -> Self {
        let corner = corner.map(|first| V::Scalar::from_f64(first as f64 + 0.5));
        let within = |number: usize| V::Scalar::from_f64(number as f64);
        Self {
            x: V::from_fn(
                #[inline(always)]
                |lane| corner[0] + within(lane % BLOCK),
            ),
            y: V::from_fn(
                #[inline(always)]
                |lane| corner[1] + within(lane / BLOCK),
            ),
            corner: corner.map(V::splat),
            right: V::from_fn(
                #[inline(always)]
                |block| within(block % BLOCKS * BLOCK),
            ),
            down: V::from_fn(
                #[inline(always)]
                |block| within(block / BLOCKS * BLOCK),
            ),
        }
    }
}
