//! From Gaussians in the world to the planes that touch the sphere at their directions, sixteen at a time.

use super::Rays;
use super::gaussian::{across, slot};
use crate::columns::finite;
use crate::each::each;
use crate::ewa::BITS;
use crate::matrix::{Mat23, Vec3, apply, apply_transposed, dot};
use crate::project::{Coefficients, colors};
use crate::settings::RasterSettings;
use crate::shape::{Group, Shape};
use crate::tiles::{self, ALPHA_MIN, Projected, record};
use crate::view::View;
use weaver_geometry::glam::DVec3;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, LaneMask, Lanes};
use weaver_scene::{CameraSlices, GaussianSlices};

/// Everything between a Gaussian's parameters and what rays see of it; backward computes it anew.
#[derive(Clone, Copy)]
pub(crate) struct Seen<V: Lanes> {
    /// Mean over its distance, in camera coordinates.
    pub direction: Vec3<V>,
    /// Distance of the mean, and 1 over it.
    pub distance: [V; 2],
    /// e1 and e2.
    pub across: Mat23<V>,
    /// Solid angle of a pixel at the mean, and its derivative by the cosine of the angle from the axis.
    pub pixel: [V; 2],
    /// On the plane.
    pub shape: Shape<V>,
}

/// Projects the shapes of Gaussians.
#[inline(always)]
pub(super) fn see<V: Lanes>(
    rays: &Rays<V::Scalar>,
    view: &View<V>,
    settings: &RasterSettings,
    group: &Group<V>,
) -> Seen<V> {
    let mut point = apply(&view.axes, group.mean);
    (0..3).for_each(|i| point[i] = point[i] + view.shift[i]);
    let distance = dot(point, point).sqrt();
    let inverse = V::constant(1.0) / distance;
    let direction = each!(3, |i| point[i] * inverse);
    let across = across(direction);
    let cosines = direction[2].to_array();
    let sizes = cosines.map(|cosine| rays.pixel_size(cosine));
    let pixel = each!(2, |k| V::from_fn(|lane| sizes[lane][k]));
    let map = each!(2, |i| apply_transposed(&view.axes, each!(3, |k| across[i][k] * inverse)));
    let shape = Shape::of(map, V::constant(settings.eps2d) * pixel[0], settings, group);
    Seen { direction, distance: [distance, inverse], across, pixel, shape }
}

/// The Gaussians of a call in the interface of the tile layer.
pub(crate) struct RayProjection<'a, T> {
    pub rays: &'a Rays<T>,
    pub gaussians: &'a GaussianSlices<'a, T>,
    pub cameras: &'a CameraSlices<'a, T>,
    pub settings: &'a RasterSettings,
}

impl<T: Real> tiles::Projection<T> for RayProjection<'_, T> {
    /// The camera, and room for the harmonics of sixteen Gaussians.
    type State<V: Lanes<Scalar = T>> = (View<V>, Coefficients<V>);

    #[inline(always)]
    fn begin<V: Lanes<Scalar = T>>(&self, view: usize) -> Self::State<V> {
        (View::of(self.cameras, view).in_lanes(), [V::zero(); _])
    }

    #[inline(always)]
    fn project<V: Lanes<Scalar = T>>(&self, state: &mut Self::State<V>, first: usize, count: usize) -> Projected<V> {
        let Self { rays, gaussians, settings, .. } = self;
        let (view, coefficients) = state;
        let group = Group::load(gaussians, first, count);
        let Seen { direction, distance: [distance, inverse], across, pixel, shape } = see(rays, view, settings, &group);
        let present = V::Mask::from_bits((u32::MAX >> (32 - count)) as u16);
        let sound = finite(group.unsound() + distance + shape.unit[0] + shape.inverse_length).and(present);
        let in_range = distance.ge(V::constant(settings.near)).and(V::constant(settings.far).ge(distance));
        let opacity = group.opacity * shape.compensation;
        let mut seen = sound.and(in_range).and(shape.det.gt(V::zero())).and(opacity.ge(V::constant(ALPHA_MIN)));
        let side = pixel[0].sqrt();
        if let Some(least) = settings.radius_clip {
            seen = seen.and(shape.three_deviations().ge(V::constant(least) * side));
        }
        let eps = V::Scalar::EPSILON.to_f64();
        let factor = each!(3, |i| shape.factor[i] * V::constant(BITS));
        let [p, q, r] = factor;
        // Rounded up by more than the error of the pixels' own arithmetic: a few units in the last place of a and b.
        let limit = (opacity * V::constant(1.0 / ALPHA_MIN)).log2() + V::constant(1e-3);
        let rounding = (q / r).abs().mul_add(V::constant(16.0 * eps), V::constant(1.0 + 16.0 * eps));
        let radius = limit.sqrt().mul_add(rounding, V::constant(16.0 * eps) * (p + q.abs() + r));
        let good = finite(radius + inverse + p + q + r);
        let mut rejected = present.and_not(sound).or(seen.and_not(good));
        seen = seen.and(good);

        // |u| <= radius and |v| <= radius along a ray, and the ray ahead.
        let u = each!(3, |i| p.mul_add(across[0][i], q * across[1][i]));
        let v = each!(3, |i| r * across[1][i]);
        let numbers = [direction, u, v].map(|vector| vector.map(V::to_array));
        let radius = radius.to_array();
        let wanted = seen.bits();
        let mut rectangle = [[V::Scalar::ZERO; 4]; LANES];
        let mut covering = 0;
        for (lane, rectangle) in rectangle.iter_mut().enumerate().filter(|(lane, _)| wanted >> lane & 1 == 1) {
            let of = |k: usize| DVec3::from_array(std::array::from_fn(|i| numbers[k][i][lane].to_f64()));
            let (d, u, v) = (of(0), of(1), of(2));
            let far = radius[lane].to_f64() * d;
            if let Some(found) = rays.cones.cover(&[u - far, -u - far, v - far, -v - far, -d], rays.around) {
                *rectangle = found.map(V::Scalar::from_f64);
                covering |= 1 << lane;
            }
        }
        seen = seen.and(V::Mask::from_bits(covering));
        let color = colors(view, gaussians, &group, first..first + count, coefficients, [&mut seen, &mut rejected]);

        let mut columns = [V::zero(); LANES];
        (0..3).for_each(|i| columns[slot::DIRECTION + i] = direction[i]);
        (0..3).for_each(|i| columns[slot::P + i] = factor[i]);
        columns[slot::OPACITY] = opacity;
        columns[record::DEPTH] = distance;
        (0..3).for_each(|i| columns[record::COLOR + i] = color[i]);
        columns[slot::PIXEL] = side;
        for (i, column) in [slot::LEFT, slot::RIGHT, slot::TOP, slot::BOTTOM].into_iter().enumerate() {
            columns[column] = V::from_fn(|lane| rectangle[lane][i]);
        }
        Projected { columns, seen, rejected }
    }
}
