//! The response of a surfel at a pixel, forward and backward.

use crate::record::slot;
use crate::{Lens, Sight};
use std::f64::consts::LOG2_E;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, LaneMask, Vector};
use weaver_splat::tiles::{Response, record};

/// Least |n.d| of a ray that meets a surfel.
pub(crate) const GRAZING: f64 = 1e-3;

/// Sums over pixels; g is the gradient with respect to the logarithm of alpha.
///
/// With D = n.d and q the gradient with respect to the range at a pixel, by its value and through a and b.
pub(crate) mod sum {
    /// sum g
    pub const G: usize = 0;
    /// sum g a, sum g b, where the plane is met.
    pub const FIRST: usize = 1;
    /// sum g a a, sum g a b, sum g b b
    pub const SECOND: usize = 3;
    /// sum q / D, sum q a / D, sum q b / D
    pub const RANGE: usize = 6;
    /// sum g du, sum g dv, where the low-pass filter is.
    pub const LOW_PASS: usize = 9;
    /// The gradient with respect to the distance of the center.
    pub const DISTANCE: usize = 11;
    pub const COUNT: usize = 12;
}

/// A surfel's numbers.
#[derive(Clone, Copy, Debug)]
pub struct Loaded<V> {
    normal: [V; 3],
    first: [V; 3],
    second: [V; 3],
    plane: V,
    at: [V; 2],
    opacity: V,
    pixel: [V; 2],
    distance: V,
}

/// Intersections of the rays of a vector of pixels with a surfel.
#[derive(Clone, Copy)]
pub struct Sample<V: Vector> {
    /// Coordinates on the surfel, in standard deviations.
    ab: [V; 2],
    /// d.t1 / s1 and d.t2 / s2, divided by D.
    slopes: [V; 2],
    /// 1 / D
    inverse: V,
    range: V,
    /// Column and row of the center, relative to the pixel.
    away: [V; 2],
    /// Mask of the pixels where the low-pass filter takes the place of the plane.
    low: V::Mask,
}

impl<V: Vector> std::fmt::Debug for Sample<V> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Sample").field("low", &self.low.bits()).finish_non_exhaustive()
    }
}

/// Numbers that pixels share: their place, and two numbers of the direction.
#[derive(Clone, Copy, Debug)]
pub struct Place<V> {
    at: V,
    /// Sine and cosine of an angle, or a coordinate at depth 1.
    direction: [V; 2],
}

#[inline(always)]
fn dot<V: Vector>(a: &[V; 3], b: &[V; 3]) -> V {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

impl<T: Real> Sight<'_, T> {
    /// A place along one axis of the image, with its direction.
    #[inline(always)]
    fn place<V: Vector>(&self, at: V, axis: usize) -> Place<V> {
        let [center, focal] = match self.camera.lens {
            Lens::Pinhole(k) => [[k.cx, k.fx], [k.cy, k.fy]][axis],
            Lens::Spherical(k) => [[k.cx, k.fx], [k.cy, k.fy]][axis],
        };
        // Few: in full precision.
        let x = at.to_array().map(|at| (at.to_f64() - center) / focal);
        let of = |f: fn(f64) -> f64| V::from_fn(|lane| V::Scalar::from_f64(f(x[lane])));
        let direction = match self.camera.lens {
            Lens::Pinhole(_) => [of(|x| x), V::zero()],
            Lens::Spherical(_) => [of(f64::sin), of(f64::cos)],
        };
        Place { at, direction }
    }
}

impl<T: Real> Response for Sight<'_, T> {
    const SUMS: usize = sum::COUNT;
    type Loaded<V: Vector> = Loaded<V>;
    type Sample<V: Vector> = Sample<V>;
    type Column<V: Vector> = Place<V>;
    type Line<V: Vector> = Place<V>;

    #[inline(always)]
    fn column<V: Vector>(&self, x: V) -> Place<V> {
        self.place(x, 0)
    }

    #[inline(always)]
    fn line<V: Vector>(&self, y: V) -> Place<V> {
        self.place(y, 1)
    }

    #[inline(always)]
    fn load<V: Vector>(&self, numbers: &[V::Scalar; LANES]) -> Loaded<V> {
        let three = |at: usize| [V::splat(numbers[at]), V::splat(numbers[at + 1]), V::splat(numbers[at + 2])];
        let (normal, first) = (three(record::COLOR), three(slot::FIRST));
        let ratio = V::splat(numbers[slot::RATIO]);
        let cross = |i: usize, j: usize| ratio * first[i].neg_mul_add(normal[j], normal[i] * first[j]);
        Loaded {
            normal,
            first,
            second: [cross(1, 2), cross(2, 0), cross(0, 1)],
            plane: V::splat(numbers[slot::PLANE]),
            at: [V::splat(numbers[slot::A]), V::splat(numbers[slot::B])],
            opacity: V::splat(numbers[slot::OPACITY]),
            pixel: [V::splat(numbers[slot::U]), V::splat(numbers[slot::V])],
            distance: V::splat(numbers[record::DEPTH]),
        }
    }

    #[inline(always)]
    fn at<V: Vector>(&self, surfel: &Loaded<V>, column: &Place<V>, line: &Place<V>) -> (V, Sample<V>) {
        let mut du = surfel.pixel[0] - column.at;
        let dv = surfel.pixel[1] - line.at;
        let ([x, cos_x], [y, cos_y]) = (column.direction, line.direction);
        let direction = match self.camera.lens {
            Lens::Pinhole(_) => {
                let one = V::constant(1.0);
                let shorter = x.mul_add(x, y.mul_add(y, one)).sqrt().recip();
                [x * shorter, y * shorter, shorter]
            }
            Lens::Spherical(_) => {
                let width = self.camera.width as f64;
                let (half, whole) = (V::constant(width / 2.0), V::constant(width));
                du = (du - whole).or(du.gt(half), du);
                du = (du + whole).or((-half).gt(du), du);
                [cos_x * cos_y, x * cos_y, y]
            }
        };
        let toward = dot(&surfel.normal, &direction);
        // Surfels face the camera: n.d is negative where their front is met. Finite elsewhere, too.
        let least = V::constant(-GRAZING);
        let met = least.ge(toward);
        let inverse = toward.min(least).recip();
        let slopes = [dot(&surfel.first, &direction) * inverse, dot(&surfel.second, &direction) * inverse];
        let ab = [surfel.plane.mul_add(slopes[0], -surfel.at[0]), surfel.plane.mul_add(slopes[1], -surfel.at[1])];
        let sigma = V::constant(0.5) * ab[0].mul_add(ab[0], ab[1] * ab[1]);
        let low_pass = du.mul_add(du, dv * dv);
        let low = sigma.gt(low_pass);
        let alpha = (V::constant(-LOG2_E) * sigma.min(low_pass)).exp2_times(surfel.opacity).only(met);
        let range = surfel.distance.or(low, surfel.plane * inverse);
        (alpha, Sample { ab, slopes, inverse, range, away: [du, dv], low })
    }

    #[inline(always)]
    fn depth<V: Vector>(&self, sample: &Sample<V>, _center: V) -> V {
        sample.range
    }

    #[inline(always)]
    fn backward<V: Vector>(&self, sample: &Sample<V>, g: V, sums: &mut [V]) {
        let mut add = |at: usize, x: V| sums[at] = sums[at] + x;
        let zero = V::zero();
        let plane = zero.or(sample.low, g);
        let low = g.only(sample.low);
        let [a, b] = sample.ab;
        let (ga, gb) = (plane * a, plane * b);
        add(sum::G, g);
        add(sum::FIRST, ga);
        add(sum::FIRST + 1, gb);
        add(sum::SECOND, ga * a);
        add(sum::SECOND + 1, ga * b);
        add(sum::SECOND + 2, gb * b);
        let q = -(ga.mul_add(sample.slopes[0], gb * sample.slopes[1]));
        add(sum::RANGE, q);
        add(sum::RANGE + 1, q * a);
        add(sum::RANGE + 2, q * b);
        add(sum::LOW_PASS, low * sample.away[0]);
        add(sum::LOW_PASS + 1, low * sample.away[1]);
    }

    #[inline(always)]
    fn depth_backward<V: Vector>(&self, sample: &Sample<V>, g: V, sums: &mut [V]) {
        let q = V::zero().or(sample.low, g * sample.inverse);
        sums[sum::RANGE] = sums[sum::RANGE] + q;
        sums[sum::RANGE + 1] = q.mul_add(sample.ab[0], sums[sum::RANGE + 1]);
        sums[sum::RANGE + 2] = q.mul_add(sample.ab[1], sums[sum::RANGE + 2]);
        sums[sum::DISTANCE] = sums[sum::DISTANCE] + g.only(sample.low);
    }
}
