//! A Gaussian as the drawing of tiles reads it.

use crate::gaussians::Gaussians;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, LaneMask, Lanes, Row};

/// Sides of a block of pixels, which fill a vector.
pub const BLOCK: usize = 4;
/// Blocks along a side of a tile.
pub const BLOCKS: usize = 4;
/// Pixels along a side of a tile.
pub const TILE: usize = BLOCK * BLOCKS;
/// Exponents of two that a block may lie beyond the cut by rounding alone.
const SLACK: f64 = 0.02;

/// Exponents of two of a Gaussian's value at so many standard deviations.
pub fn exponent(deviations: f64) -> f64 {
    -0.5 * deviations * deviations * std::f64::consts::LOG2_E
}

/// The numbers of a Gaussian: center, the factor of its precision, slopes of the lines on which it is largest.
///
/// `log2 w = -((a dx + b dy)^2 + (c dy)^2)`, the Cholesky factor of the precision, whose squares cannot cancel.
pub fn record<T: Real>(gaussians: &Gaussians<T>, i: usize) -> Row<T> {
    let [s1, s2] = [gaussians.scales[2 * i], gaussians.scales[2 * i + 1]].map(|s| s.to_f64());
    let (sin, cos) = gaussians.angles[i].to_f64().sin_cos();
    let k = 0.5 * std::f64::consts::LOG2_E;
    let (p1, p2) = (k / (s1 * s1), k / (s2 * s2));
    let xx = p1 * cos * cos + p2 * sin * sin;
    let yy = p1 * sin * sin + p2 * cos * cos;
    let xy = (p1 - p2) * sin * cos;
    let a = xx.sqrt();
    let numbers = [a, xy / a, k / (s1 * s2 * a), -xy / yy, -xy / xx];
    let mut row = Row([T::ZERO; LANES]);
    row.0[..2].copy_from_slice(&gaussians.centers[2 * i..2 * i + 2]);
    row.0[2..7].iter_mut().zip(numbers).for_each(|(to, x)| *to = T::from_f64(x));
    row
}

/// Half the sides of the box around an ellipse of so many standard deviations.
pub fn half_box<T: Real>(gaussians: &Gaussians<T>, i: usize, deviations: f64) -> [f64; 2] {
    let [s1, s2] = [gaussians.scales[2 * i], gaussians.scales[2 * i + 1]].map(|s| s.to_f64().powi(2));
    let (sin, cos) = gaussians.angles[i].to_f64().sin_cos();
    let (sin, cos) = (sin * sin, cos * cos);
    [s1 * cos + s2 * sin, s1 * sin + s2 * cos].map(|variance| deviations * variance.sqrt())
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

    /// Distances from the center.
    #[inline(always)]
    pub fn offset(&self, x: V, y: V) -> [V; 2] {
        [x - self.x, y - self.y]
    }

    /// Base-2 logarithm of the value so far from the center.
    #[inline(always)]
    fn log2(&self, [dx, dy]: [V; 2]) -> V {
        let u = self.b.mul_add(dy, self.a * dx);
        let v = self.c * dy;
        v.neg_mul_add(v, u.neg_mul_add(u, V::zero()))
    }

    /// Value so far from the center, 0 beyond the cut at the exponent `cut`.
    #[inline(always)]
    pub fn value(&self, from_center: [V; 2], cut: V) -> V {
        let e = self.log2(from_center);
        e.exp2_times(V::constant(1.0)).only(e.ge(cut))
    }

    /// The blocks of a tile that the ellipse meets, one bit per block; `first` are the first pixels of the blocks.
    ///
    /// The largest value on a rectangle that does not hold the center lies on one of the two sides that face it.
    #[inline(always)]
    pub fn blocks(&self, first: [V; 2], cut: V) -> u16 {
        let zero = V::zero();
        let far = V::constant((BLOCK - 1) as f64);
        let [x0, y0] = self.offset(first[0], first[1]);
        let [x1, y1] = [x0 + far, y0 + far];
        let (x, y) = (zero.max(x0).min(x1), zero.max(y0).min(y1));
        let beside = self.log2([x, (self.y_by_x * x).max(y0).min(y1)]);
        let above = self.log2([(self.x_by_y * y).max(x0).min(x1), y]);
        beside.max(above).ge(cut - V::constant(SLACK)).bits()
    }
}

/// Pixel middles of a tile.
pub struct Grid<V> {
    /// x of the lanes of each column of blocks.
    pub x: [V; BLOCKS],
    /// y of the lanes of each row of blocks.
    pub y: [V; BLOCKS],
    /// First pixel of each block, a lane per block.
    pub first: [V; 2],
}

impl<V: Lanes> Grid<V> {
    #[inline(always)]
    pub fn new(corner: [usize; 2]) -> Self {
        let middle = |axis: usize, offset: usize| V::Scalar::from_f64((corner[axis] + offset) as f64 + 0.5);
        let (mut x, mut y) = ([V::zero(); BLOCKS], [V::zero(); BLOCKS]);
        for block in 0..BLOCKS {
            x[block] = V::from_fn(
                #[inline(always)]
                |lane| middle(0, block * BLOCK + lane % BLOCK),
            );
            y[block] = V::from_fn(
                #[inline(always)]
                |lane| middle(1, block * BLOCK + lane / BLOCK),
            );
        }
        let first = [
            V::from_fn(
                #[inline(always)]
                |block| middle(0, block % BLOCKS * BLOCK),
            ),
            V::from_fn(
                #[inline(always)]
                |block| middle(1, block / BLOCKS * BLOCK),
            ),
        ];
        Self { x, y, first }
    }

    /// Pixel middles of a block.
    #[inline(always)]
    pub fn block(&self, block: usize) -> [V; 2] {
        [self.x[block % BLOCKS], self.y[block / BLOCKS]]
    }
}
