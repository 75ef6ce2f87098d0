//! The pinhole EWA Gaussian: its record, the pixels it covers, its alpha at a pixel.
//!
//! The inverse of the image covariance S has the Cholesky factor L = [[p, q], [0, r]]: with d = (dx, dy) from the
//! center to a pixel, u = p dx + q dy and v = r dy make d^T S^-1 d = u^2 + v^2, a sum of squares that never turns
//! negative. p, q, r are stored times [`BITS`], so that the Gaussian is opacity times 2^-(u^2 + v^2).

use crate::each::each;
use crate::tiles::{Footprint, Response};
use weaver_kernels::lanes::{LANES, Lanes, Vector};

/// sqrt(log2(e) / 2): exp(-x^2 / 2) = 2^-(BITS x)^2.
pub(crate) const BITS: f64 = 0.849_321_800_288_019_2;

/// Slots of a record, beside depth and color ([`crate::tiles::record`]).
pub(crate) mod slot {
    /// Center, pixels.
    pub const X: usize = 0;
    pub const Y: usize = 1;
    /// u = p dx + q dy
    pub const P: usize = 2;
    pub const Q: usize = 3;
    /// v = r dy
    pub const R: usize = 4;
    /// Opacity, compensated when antialiased.
    pub const OPACITY: usize = 5;
    /// Pixels that rounding may move the outline by.
    pub const SLACK: usize = 6;
    /// Largest |dy| inside the outline, with slack.
    pub const HALF_HEIGHT: usize = 11;
    /// dy where the outline's dx is largest; dx is smallest at its negative.
    pub const DY_OF_RIGHT: usize = 12;
    /// u^2 + v^2 on the outline, where alpha falls below the visible minimum (rounded up).
    pub const REACH: usize = 13;
    /// 1 / p
    pub const WIDTH: usize = 14;
    /// q / p
    pub const TILT: usize = 15;
}

/// Number of sums over pixels.
pub(crate) const SUMS: usize = 6;

/// Slots of the sums over pixels of [`Response::backward`]; g = alpha dL/dalpha where alpha is not capped.
pub(crate) mod moment {
    /// sum g
    pub const G: usize = 0;
    /// sum g u, sum g v
    pub const FIRST: usize = 1;
    /// sum g u^2, sum g u v, sum g v^2
    pub const SECOND: usize = 3;
}

/// The pair of traits for Gaussians that a pinhole camera sees through the EWA approximation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EwaGaussian;

/// Half of the width of the outlines at dy.
#[inline(always)]
fn half_width<V: Lanes>(columns: &[V; LANES], dy: V) -> V {
    let v = columns[slot::R] * dy;
    v.neg_mul_add(v, columns[slot::REACH]).max(V::zero()).sqrt() * columns[slot::WIDTH]
}

/// The outline is the ellipse where alpha reaches the visible minimum.
impl Footprint for EwaGaussian {
    #[inline(always)]
    fn rows<V: Lanes>(&self, columns: &[V; LANES]) -> (V, V) {
        let (y, half_height) = (columns[slot::Y], columns[slot::HALF_HEIGHT]);
        (y - half_height, y + half_height)
    }

    #[inline(always)]
    fn span<V: Lanes>(&self, columns: &[V; LANES], top: V, bottom: V) -> (V, V, V::Mask) {
        let (x, y, slack) = (columns[slot::X], columns[slot::Y], columns[slot::SLACK]);
        let (half_height, dy_of_right) = (columns[slot::HALF_HEIGHT], columns[slot::DY_OF_RIGHT]);
        let low = (top - y - slack).max(-half_height);
        let high = (bottom - y + slack).min(half_height);
        let at_right = dy_of_right.max(low).min(high);
        let at_left = (-dy_of_right).max(low).min(high);
        let right = x + slack + columns[slot::TILT].neg_mul_add(at_right, half_width(columns, at_right));
        let left = x - slack - columns[slot::TILT].mul_add(at_left, half_width(columns, at_left));
        (left, right, high.ge(low))
    }
}

/// Center, p q r, and opacity of a Gaussian.
#[derive(Clone, Copy)]
pub(crate) struct Loaded<V> {
    center: [V; 2],
    factor: [V; 3],
    opacity: V,
}

impl Response for EwaGaussian {
    const WITHOUT_DEPTH: bool = true;
    const SUMS: usize = SUMS;
    type Loaded<V: Vector> = Loaded<V>;
    /// u and v.
    type Sample<V: Vector> = [V; 2];
    type Column<V: Vector> = V;
    type Line<V: Vector> = V;

    #[inline(always)]
    fn column<V: Vector>(&self, x: V) -> V {
        x
    }

    #[inline(always)]
    fn line<V: Vector>(&self, y: V) -> V {
        y
    }

    #[inline(always)]
    fn load<V: Vector>(&self, record: &[V::Scalar; LANES]) -> Loaded<V> {
        Loaded {
            center: [V::splat(record[slot::X]), V::splat(record[slot::Y])],
            factor: each!(3, |i| V::splat(record[slot::P + i])),
            opacity: V::splat(record[slot::OPACITY]),
        }
    }

    #[inline(always)]
    fn at<V: Vector>(&self, gaussian: &Loaded<V>, &x: &V, &y: &V) -> (V, [V; 2]) {
        let [p, q, r] = gaussian.factor;
        let (dx, dy) = (x - gaussian.center[0], y - gaussian.center[1]);
        let (u, v) = (p.mul_add(dx, q * dy), r * dy);
        (u.neg_mul_add(u, -(v * v)).exp2_times(gaussian.opacity), [u, v])
    }

    #[inline(always)]
    fn backward<V: Vector>(&self, &[u, v]: &[V; 2], g: V, sums: &mut [V]) {
        let (gu, gv) = (g * u, g * v);
        sums[moment::G] = sums[moment::G] + g;
        sums[moment::FIRST] = sums[moment::FIRST] + gu;
        sums[moment::FIRST + 1] = sums[moment::FIRST + 1] + gv;
        sums[moment::SECOND] = gu.mul_add(u, sums[moment::SECOND]);
        sums[moment::SECOND + 1] = gu.mul_add(v, sums[moment::SECOND + 1]);
        sums[moment::SECOND + 2] = gv.mul_add(v, sums[moment::SECOND + 2]);
    }

    #[inline(always)]
    fn screen_gradient<V: Vector>(&self, gaussian: &Loaded<V>, &[u, v]: &[V; 2], g: V) -> [V; 2] {
        let [p, q, r] = gaussian.factor;
        let (gu, gv) = (g * u, g * v);
        // p, q, r and u, v both hold the factor BITS.
        let natural = V::constant(1.0 / (BITS * BITS));
        [natural * (p * gu), natural * q.mul_add(gu, r * gv)]
    }
}
