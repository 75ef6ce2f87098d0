//! The Gaussian that rays see: its record, the pixels it covers, its alpha at a pixel.

use super::Rays;
use crate::each::each;
use crate::ewa::{BITS, moment};
use crate::tiles::{BLOCK, Footprint, Record, Response};
use std::any::Any;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, LaneMask, Lanes, Row, Vector};

/// Slots of a record, beside depth and color ([`crate::tiles::record`]).
pub(super) mod slot {
    /// Direction of the mean, 3 numbers.
    pub const DIRECTION: usize = 0;
    /// p, q, r of u = p a + q b and v = r b, times [`BITS`](crate::ewa::BITS).
    pub const P: usize = 3;
    /// Opacity, compensated when antialiased.
    pub const OPACITY: usize = 6;
    /// Side of a pixel at the mean, radians.
    pub const PIXEL: usize = 11;
    /// Rectangle of pixels: left, right, top, bottom; left exceeds right around the seam of a sphere.
    pub const LEFT: usize = 12;
    pub const RIGHT: usize = 13;
    pub const TOP: usize = 14;
    pub const BOTTOM: usize = 15;
}

/// Number of sums over pixels.
pub(super) const SUMS: usize = 8;
/// Slot of the sums of g (u^2 + v^2) u and of g (u^2 + v^2) v, after those of [`moment`].
pub(super) const THIRD: usize = moment::SECOND + 3;
/// Least cosine of the angle between a ray and a Gaussian's direction.
const AHEAD: f64 = 1e-6;

/// The pair of traits for Gaussians that rays see.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayGaussian<'a, T>(pub &'a Rays<T>);

/// p, q, r per pixel at the mean, in place of radians, times [`BITS`].
pub(crate) fn factor_in_pixels<T: Real>(record: &Record<T>) -> [T; 3] {
    std::array::from_fn(|i| record.0[slot::P + i] * record.0[slot::PIXEL])
}

/// Two directions across one of length 1 (Duff et al., Building an Orthonormal Basis, Revisited, 2017).
#[inline(always)]
pub(super) fn across<V: Vector>([x, y, z]: [V; 3]) -> [[V; 3]; 2] {
    let one = V::constant(1.0);
    let sign = one.or(z.ge(V::zero()), -one);
    let a = -(one / (sign + z));
    let b = x * y * a;
    [[one + sign * x * x * a, sign * b, -(sign * x)], [b, (y * y).mul_add(a, sign), -y]]
}

impl<T: Real> Footprint for RayGaussian<'_, T> {
    #[inline(always)]
    fn rows<V: Lanes>(&self, columns: &[V; LANES]) -> (V, V) {
        (columns[slot::TOP], columns[slot::BOTTOM])
    }

    #[inline(always)]
    fn span<V: Lanes>(&self, columns: &[V; LANES], top: V, bottom: V) -> (V, V, V::Mask) {
        let touched = bottom.ge(columns[slot::TOP]).and(columns[slot::BOTTOM].ge(top));
        let (left, right) = (columns[slot::LEFT], columns[slot::RIGHT]);
        // Around the seam the first interval is the right one.
        (left, right.or(right.ge(left), V::constant(1e7)), touched)
    }

    #[inline(always)]
    fn second_span<V: Lanes>(&self, columns: &[V; LANES], top: V, bottom: V) -> Option<(V, V, V::Mask)> {
        self.0.around.then(|| {
            let touched = bottom.ge(columns[slot::TOP]).and(columns[slot::BOTTOM].ge(top));
            let (left, right) = (columns[slot::LEFT], columns[slot::RIGHT]);
            (V::zero(), right, touched.and(left.gt(right)))
        })
    }
}

/// A Gaussian's direction, the gradients of u d . w and of v d . w by w, and its opacity.
#[derive(Clone, Copy)]
pub(crate) struct Loaded<V> {
    direction: [V; 3],
    u: [V; 3],
    v: [V; 3],
    factor: [V; 3],
    opacity: V,
    pixel: V,
}

#[inline(always)]
fn dot<V: Vector>(a: [V; 3], b: [V; 3]) -> V {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

impl<'a, T: Real> Response for RayGaussian<'a, T> {
    const SUMS: usize = SUMS;
    type Loaded<V: Vector> = Loaded<V>;
    /// u and v.
    type Sample<V: Vector> = [V; 2];
    /// The column of the block.
    type Column<V: Vector> = usize;
    /// The rays of the row of blocks, and the part of the blocks.
    type Line<V: Vector> = (&'a [[Row<V::Scalar>; 3]], usize);

    #[inline(always)]
    fn column<V: Vector>(&self, x: V) -> usize {
        x.to_array()[0].to_f64() as usize / BLOCK
    }

    #[inline(always)]
    fn line<V: Vector>(&self, y: V) -> Self::Line<V> {
        let row = y.to_array()[0].to_f64() as usize;
        let blocks: &dyn Any = &self.0.blocks;
        let blocks: &Vec<[Row<V::Scalar>; 3]> = blocks.downcast_ref().expect("rays of the scalar of the images");
        (&blocks[row / BLOCK * self.0.across..], row % BLOCK / (V::WIDTH / BLOCK))
    }

    #[inline(always)]
    fn load<V: Vector>(&self, record: &[V::Scalar; LANES]) -> Loaded<V> {
        let direction = each!(3, |i| V::splat(record[slot::DIRECTION + i]));
        let factor = each!(3, |i| V::splat(record[slot::P + i]));
        let ([e1, e2], [p, q, r]) = (across(direction), factor);
        Loaded {
            direction,
            u: each!(3, |i| p.mul_add(e1[i], q * e2[i])),
            v: each!(3, |i| r * e2[i]),
            factor,
            opacity: V::splat(record[slot::OPACITY]),
            pixel: V::splat(record[slot::PIXEL]),
        }
    }

    #[inline(always)]
    fn at<V: Vector>(&self, gaussian: &Loaded<V>, &column: &usize, &(row, part): &Self::Line<V>) -> (V, [V; 2]) {
        let rows = &row[column];
        let ray = each!(3, |i| V::load_part(&rows[i].0, part));
        let one = V::constant(1.0);
        let cosine = dot(gaussian.direction, ray);
        let ahead = cosine.gt(V::constant(AHEAD));
        let inverse = one / cosine.or(ahead, one);
        let (u, v) = (dot(gaussian.u, ray) * inverse, dot(gaussian.v, ray) * inverse);
        let alpha = u.neg_mul_add(u, -(v * v)).exp2_times(gaussian.opacity);
        (alpha.only(ahead), [u, v])
    }

    #[inline(always)]
    fn backward<V: Vector>(&self, &[u, v]: &[V; 2], g: V, sums: &mut [V]) {
        let (gu, gv) = (g * u, g * v);
        let (guu, gvv) = (gu * u, gv * v);
        let square = guu + gvv;
        sums[moment::G] = sums[moment::G] + g;
        sums[moment::FIRST] = sums[moment::FIRST] + gu;
        sums[moment::FIRST + 1] = sums[moment::FIRST + 1] + gv;
        sums[moment::SECOND] = sums[moment::SECOND] + guu;
        sums[moment::SECOND + 1] = gu.mul_add(v, sums[moment::SECOND + 1]);
        sums[moment::SECOND + 2] = sums[moment::SECOND + 2] + gvv;
        sums[THIRD] = square.mul_add(u, sums[THIRD]);
        sums[THIRD + 1] = square.mul_add(v, sums[THIRD + 1]);
    }

    #[inline(always)]
    fn screen_gradient<V: Vector>(&self, gaussian: &Loaded<V>, &[u, v]: &[V; 2], g: V) -> [V; 2] {
        let ([p, q, r], (gu, gv)) = (gaussian.factor, (g * u, g * v));
        // p, q, r and u, v both hold the factor BITS.
        let natural = V::constant(1.0 / (BITS * BITS)) * gaussian.pixel;
        [natural * (p * gu), natural * q.mul_add(gu, r * gv)]
    }
}
