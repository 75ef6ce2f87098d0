//! From Gaussians in the world to splats on the image plane, sixteen at a time.
//!
//! The image covariance is S = M M^T + eps I with M = J A R diag(s), a 2x3 matrix. Working from M instead of S,
//! nothing cancels: det S = |m1 x m2|^2 + eps (|m1|^2 + |m2|^2) + eps^2 is a sum of positive terms, so that long thin
//! splats are exact in `f32` too.

use crate::columns::{columns, finite, prefetch_rows, wide_columns};
use crate::each::each;
use crate::ewa::{BITS, slot};
use crate::matrix::{Mat23, Mat33, Vec3, apply, cross, dot, product};
use crate::rotation::rotation;
use crate::settings::{RATIO_FLOOR, RasterSettings};
use crate::sh;
use crate::tiles::{self, ALPHA_MIN, Projected, record};
use crate::view::View;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, LaneMask, Lanes};
use weaver_scene::{CameraSlices, Color, GaussianSlices};

/// Room for the coefficients of the largest degree in columns.
pub(crate) type Coefficients<V> = [V; (3 * weaver_geometry::sh::MAX_COEFFICIENTS).next_multiple_of(LANES)];

/// The shapes of sixteen Gaussians.
#[derive(Clone, Copy)]
pub(crate) struct Group<V> {
    pub mean: Vec3<V>,
    pub quat: [V; 4],
    pub scale: Vec3<V>,
    pub opacity: V,
}

impl<V: Lanes> Group<V> {
    /// Gaussians `first..first + count`; lanes beyond repeat the last.
    #[inline(always)]
    pub fn load(gaussians: &GaussianSlices<'_, V::Scalar>, first: usize, count: usize) -> Self {
        let [opacity] = columns(gaussians.opacities, first, count);
        Self {
            mean: columns(gaussians.means, first, count),
            quat: columns(gaussians.quats, first, count),
            scale: columns(gaussians.scales, first, count),
            opacity,
        }
    }

    /// 0 where all numbers are finite, else not a number.
    #[inline(always)]
    fn unsound(&self) -> V {
        let zero = V::zero();
        let [x, y, z] = self.mean;
        let [a, b, c, d] = self.quat;
        let [p, q, r] = self.scale;
        let mut sum = self.opacity * zero;
        for part in [x, y, z, a, b, c, d, p, q, r] {
            sum = part.mul_add(zero, sum);
        }
        sum
    }
}

/// Everything between a Gaussian's parameters and its splat's shape; backward computes it anew.
#[derive(Clone, Copy)]
pub(crate) struct Projection<V: Lanes> {
    /// Mean in camera coordinates.
    pub point: Vec3<V>,
    /// x/z and y/z.
    pub free: [V; 2],
    /// x/z and y/z within their limits.
    pub slope: [V; 2],
    /// Masks of the ones within their limits.
    pub within: [V::Mask; 2],
    /// fx/z, fy/z.
    pub zoom: [V; 2],
    /// 1/z
    pub inverse_z: V,
    /// J A.
    pub map: Mat23<V>,
    /// Unit quaternion.
    pub unit: [V; 4],
    /// 1 over the length of the quaternion given.
    pub inverse_length: V,
    /// R.
    pub rotation: Mat33<V>,
    /// M = J A R diag(s).
    pub m: Mat23<V>,
    /// m1 x m2.
    pub normal: Vec3<V>,
    /// S xx, S yy.
    pub variance: [V; 2],
    /// det S before the blur.
    pub sharp: V,
    /// det S.
    pub det: V,
    /// Factor of the opacity.
    pub compensation: V,
    /// Mask of factors that depend on the shape: antialiased and above the floor.
    pub compensated: V::Mask,
    /// p, q, r of the splat, of sigma = (u^2 + v^2) / 2.
    pub factor: Vec3<V>,
}

/// Projects the shapes of Gaussians.
#[inline(always)]
pub(crate) fn projection<V: Lanes>(view: &View<V>, settings: &RasterSettings, group: &Group<V>) -> Projection<V> {
    let one = V::constant(1.0);
    let mut point = apply(&view.axes, group.mean);
    (0..3).for_each(|i| point[i] = point[i] + view.shift[i]);
    let inverse_z = one / point[2];
    let free = [point[0] * inverse_z, point[1] * inverse_z];
    let within = each!(2, |i| free[i].ge(view.low[i]).and(view.high[i].ge(free[i])));
    let slope = each!(2, |i| free[i].max(view.low[i]).min(view.high[i]));
    let zoom = each!(2, |i| view.focal[i] * inverse_z);
    let map = each!(2, |i| each!(3, |j| zoom[i] * slope[i].neg_mul_add(view.axes[2][j], view.axes[i][j])));

    // Scaled first, so that no length overflows.
    let largest = {
        let [a, b, c, d] = each!(4, |i| group.quat[i].abs());
        a.max(b).max(c.max(d))
    };
    let scaled = each!(4, |i| group.quat[i] / largest);
    let [w, x, y, z] = scaled;
    let length = x.mul_add(x, y.mul_add(y, z.mul_add(z, w * w))).sqrt();
    let inverse = one / length;
    let unit = each!(4, |i| scaled[i] * inverse);
    let rotation = rotation(one, unit);

    let turned = product(&map, &rotation);
    let m = each!(2, |i| each!(3, |j| turned[i][j] * group.scale[j]));
    let eps = V::constant(settings.eps2d);
    let normal = cross(m[0], m[1]);
    let squares = [dot(m[0], m[0]), dot(m[1], m[1])];
    let variance = each!(2, |i| squares[i] + eps);
    let sharp = dot(normal, normal);
    let det = sharp + eps * (squares[0] + squares[1]) + eps * eps;
    let deviation = variance[1].sqrt();
    let (inverse_root, inverse_deviation) = (one / det.sqrt(), one / deviation);
    let factor = [deviation * inverse_root, -dot(m[0], m[1]) * inverse_deviation * inverse_root, inverse_deviation];
    let floor = V::constant(RATIO_FLOOR);
    let ratio = sharp / det;
    let none = V::Mask::from_bits(0);
    let (compensation, compensated) =
        if settings.antialiased { (ratio.max(floor).sqrt(), ratio.gt(floor)) } else { (one, none) };
    Projection {
        point,
        free,
        slope,
        within,
        zoom,
        inverse_z,
        map,
        unit,
        inverse_length: inverse / largest,
        rotation,
        m,
        normal,
        variance,
        sharp,
        det,
        compensation,
        compensated,
        factor,
    }
}

/// The Gaussians of a call in the interface of the tile layer.
pub(crate) struct EwaProjection<'a, T> {
    pub gaussians: &'a GaussianSlices<'a, T>,
    pub cameras: &'a CameraSlices<'a, T>,
    pub settings: &'a RasterSettings,
}

impl<T: Real> tiles::Projection<T> for EwaProjection<'_, T> {
    /// The camera, and room for the harmonics of sixteen Gaussians.
    type State<V: Lanes<Scalar = T>> = (View<V>, Coefficients<V>);

    #[inline(always)]
    fn begin<V: Lanes<Scalar = T>>(&self, view: usize) -> Self::State<V> {
        (View::of(self.cameras, view).in_lanes(), [V::zero(); _])
    }

    #[inline(always)]
    fn project<V: Lanes<Scalar = T>>(&self, state: &mut Self::State<V>, first: usize, count: usize) -> Projected<V> {
        let (view, coefficients) = state;
        splats(view, self.settings, self.gaussians, (first, count), coefficients)
    }
}

/// Projects Gaussians `first..first + count`. Colors and features count only where a Gaussian may be seen: behind the
/// camera, or if it is too faint, they reject nothing.
#[inline(always)]
pub(crate) fn splats<V: Lanes>(
    view: &View<V>,
    settings: &RasterSettings,
    gaussians: &GaussianSlices<'_, V::Scalar>,
    (first, count): (usize, usize),
    coefficients: &mut Coefficients<V>,
) -> Projected<V> {
    let group = Group::load(gaussians, first, count);
    let shape = projection(view, settings, &group);
    let present = V::Mask::from_bits((u32::MAX >> (32 - count)) as u16);
    // A quaternion of zeros has no unit; one too short for 1 / |q| has no gradient.
    let sound = finite(group.unsound() + shape.point[2] + shape.unit[0] + shape.inverse_length).and(present);
    let z = shape.point[2];
    let in_range = z.ge(V::constant(settings.near)).and(V::constant(settings.far).ge(z));
    let opacity = group.opacity * shape.compensation;
    let mut seen = sound.and(in_range).and(shape.det.gt(V::zero())).and(opacity.ge(V::constant(ALPHA_MIN)));
    if let Some(least) = settings.radius_clip {
        seen = seen.and(three_deviations(&shape).ge(V::constant(least)));
    }

    let eps = <V::Scalar as Real>::EPSILON.to_f64();
    let [p, q, r] = each!(3, |i| shape.factor[i] * V::constant(BITS));
    // Rounded up by more than the error of the pixels' own arithmetic: a few units in the last place of p dx and q dy,
    // and the latter is at most |q| / r times v.
    let limit = (opacity * V::constant(1.0 / ALPHA_MIN)).log2() + V::constant(1e-3);
    let rounding = (q / r).abs().mul_add(V::constant(16.0 * eps), V::constant(1.0 + 16.0 * eps));
    let radius = limit.sqrt() * rounding;
    let (width, tall) = (V::constant(1.0) / p, radius / r);
    let tilt = q * width;
    let x = view.focal[0].mul_add(shape.free[0], view.principal[0]);
    let y = view.focal[1].mul_add(shape.free[1], view.principal[1]);
    let extent = x.abs() + y.abs() + tilt.abs().mul_add(tall, radius * width);
    let slack = extent.mul_add(V::constant(8.0 * eps), V::constant(1e-3));
    let half_height = tall + slack;
    let dy_of_right = -q * radius / (r * q.mul_add(q, r * r).sqrt());
    let good = finite(slack + dy_of_right + half_height + p + r);
    let mut rejected = present.and_not(sound).or(seen.and_not(good));
    seen = seen.and(good);

    let mut color = [V::zero(); 3];
    match gaussians.color {
        Color::None => {}
        Color::Plain(values) => {
            color = columns(values, first, count);
            let good = finite(color[0] * V::zero() + color[1] * V::zero() + color[2] * V::zero());
            rejected = rejected.or(seen.and_not(good));
            seen = seen.and(good);
        }
        Color::Sh { coefficients: values, degree } if seen.bits() != 0 => {
            let len = 3 * (degree + 1) * (degree + 1);
            prefetch_rows(values, (first + LANES) * len, LANES * len);
            wide_columns(&values[first * len..(first + count) * len], len, coefficients);
            let sight = each!(3, |i| group.mean[i] - view.center[i]);
            let (sum, unsound) = sh::color(degree, sight, coefficients);
            let good = finite(unsound + sum[0] + sum[1] + sum[2]);
            rejected = rejected.or(seen.and_not(good));
            seen = seen.and(good);
            color = each!(3, |i| sum[i].max(V::zero()));
        }
        Color::Sh { .. } => {}
    }

    if let Some(features) = gaussians.features {
        let sound = |lane: usize| features.of(first + lane).iter().all(|x| x.is_finite());
        let lanes = (0..count).filter(|&lane| sound(lane)).fold(0, |bits, lane| bits | 1 << lane);
        let good = V::Mask::from_bits(lanes);
        rejected = rejected.or(seen.and_not(good));
        seen = seen.and(good);
    }

    let mut columns = [V::zero(); LANES];
    columns[slot::X] = x;
    columns[slot::Y] = y;
    columns[slot::P] = p;
    columns[slot::Q] = q;
    columns[slot::R] = r;
    columns[slot::OPACITY] = opacity;
    columns[slot::SLACK] = slack;
    columns[record::DEPTH] = z;
    (0..3).for_each(|i| columns[record::COLOR + i] = color[i]);
    columns[slot::HALF_HEIGHT] = half_height;
    columns[slot::DY_OF_RIGHT] = dy_of_right;
    columns[slot::REACH] = radius * radius * V::constant(1.0 + 8.0 * eps);
    columns[slot::WIDTH] = width;
    columns[slot::TILT] = tilt;
    Projected { columns, seen, rejected }
}

/// Three standard deviations along the longest image axis, pixels.
#[inline(always)]
fn three_deviations<V: Lanes>(shape: &Projection<V>) -> V {
    let mean = V::constant(0.5) * (shape.variance[0] + shape.variance[1]);
    let spread = mean.mul_add(mean, -shape.det).max(V::zero()).sqrt();
    V::constant(3.0) * (mean + spread).sqrt()
}
