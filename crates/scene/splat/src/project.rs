//! From Gaussians in the world to splats on the image plane of a pinhole, sixteen at a time.

use crate::columns::{columns, finite, prefetch_rows, wide_columns};
use crate::each::each;
use crate::ewa::{BITS, slot};
use crate::matrix::{Vec3, apply};
use crate::settings::RasterSettings;
use crate::sh;
use crate::shape::{Group, Shape};
use crate::tiles::{self, ALPHA_MIN, Projected, record};
use crate::view::View;
use std::ops::Range;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, LaneMask, Lanes};
use weaver_scene::{CameraSlices, Color, GaussianSlices};

/// Room for the coefficients of the largest degree in columns.
pub(crate) type Coefficients<V> = [V; (3 * weaver_geometry::sh::MAX_COEFFICIENTS).next_multiple_of(LANES)];

/// Everything between a Gaussian's parameters and its splat; backward computes it anew.
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
    /// On the image, by J A.
    pub shape: Shape<V>,
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
    let shape = Shape::of(map, V::constant(settings.eps2d), settings, group);
    Projection { point, free, slope, within, zoom, inverse_z, shape }
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
        splats(view, self.settings, self.gaussians, first..first + count, coefficients)
    }
}

/// Projects the Gaussians of these numbers, sixteen at most. Colors and features count only where a Gaussian may be
/// seen: those of one behind the camera, or too faint, reject nothing.
#[inline(always)]
pub(crate) fn splats<V: Lanes>(
    view: &View<V>,
    settings: &RasterSettings,
    gaussians: &GaussianSlices<'_, V::Scalar>,
    numbers: Range<usize>,
    coefficients: &mut Coefficients<V>,
) -> Projected<V> {
    let (first, count) = (numbers.start, numbers.len());
    let group = Group::load(gaussians, first, count);
    let projected = projection(view, settings, &group);
    let shape = &projected.shape;
    let present = V::Mask::from_bits((u32::MAX >> (32 - count)) as u16);
    // A quaternion of zeros has no unit; one too short for 1 / |q| has no gradient.
    let sound = finite(group.unsound() + projected.point[2] + shape.unit[0] + shape.inverse_length).and(present);
    let z = projected.point[2];
    let in_range = z.ge(V::constant(settings.near)).and(V::constant(settings.far).ge(z));
    let opacity = group.opacity * shape.compensation;
    let mut seen = sound.and(in_range).and(shape.det.gt(V::zero())).and(opacity.ge(V::constant(ALPHA_MIN)));
    if let Some(least) = settings.radius_clip {
        seen = seen.and(shape.three_deviations().ge(V::constant(least)));
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
    let x = view.focal[0].mul_add(projected.free[0], view.principal[0]);
    let y = view.focal[1].mul_add(projected.free[1], view.principal[1]);
    let extent = x.abs() + y.abs() + tilt.abs().mul_add(tall, radius * width);
    let slack = extent.mul_add(V::constant(8.0 * eps), V::constant(1e-3));
    let half_height = tall + slack;
    let dy_of_right = -q * radius / (r * q.mul_add(q, r * r).sqrt());
    let good = finite(slack + dy_of_right + half_height + p + r);
    let mut rejected = present.and_not(sound).or(seen.and_not(good));
    seen = seen.and(good);

    let color = colors(view, gaussians, &group, numbers, coefficients, [&mut seen, &mut rejected]);

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

/// The colors of the Gaussians of these numbers toward the camera. Gaussians whose colors or features are not finite
/// are rejected, if they were seen.
#[inline(always)]
pub(crate) fn colors<V: Lanes>(
    view: &View<V>,
    gaussians: &GaussianSlices<'_, V::Scalar>,
    group: &Group<V>,
    numbers: Range<usize>,
    coefficients: &mut Coefficients<V>,
    [seen, rejected]: [&mut V::Mask; 2],
) -> Vec3<V> {
    let (first, count) = (numbers.start, numbers.len());
    let mut color = [V::zero(); 3];
    match gaussians.color {
        Color::None => {}
        Color::Plain(values) => {
            color = columns(values, first, count);
            let good = finite(color[0] * V::zero() + color[1] * V::zero() + color[2] * V::zero());
            *rejected = rejected.or(seen.and_not(good));
            *seen = seen.and(good);
        }
        Color::Sh { coefficients: values, degree } if seen.bits() != 0 => {
            let len = 3 * (degree + 1) * (degree + 1);
            prefetch_rows(values, (first + LANES) * len, LANES * len);
            wide_columns(&values[first * len..(first + count) * len], len, coefficients);
            let sight = each!(3, |i| group.mean[i] - view.center[i]);
            let (sum, unsound) = sh::color(degree, sight, coefficients);
            let good = finite(unsound + sum[0] + sum[1] + sum[2]);
            *rejected = rejected.or(seen.and_not(good));
            *seen = seen.and(good);
            color = each!(3, |i| sum[i].max(V::zero()));
        }
        Color::Sh { .. } => {}
    }

    if let Some(features) = gaussians.features {
        let sound = |lane: usize| features.of(first + lane).iter().all(|x| x.is_finite());
        let lanes = (0..count).filter(|&lane| sound(lane)).fold(0, |bits, lane| bits | 1 << lane);
        let good = V::Mask::from_bits(lanes);
        *rejected = rejected.or(seen.and_not(good));
        *seen = seen.and(good);
    }
    color
}
