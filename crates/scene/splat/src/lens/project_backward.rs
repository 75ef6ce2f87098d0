//! Backward of the projection to planes across the Gaussians' directions, sixteen Gaussians at a time.

use super::Rays;
use super::gaussian::{SUMS, THIRD};
use super::project::{Seen, see};
use crate::each::each;
use crate::ewa::{BITS, moment as shape_sum};
use crate::gaussian_pass::Projector;
use crate::matrix::{apply_transposed, dot};
use crate::project_backward::Upstream;
use crate::settings::RasterSettings;
use crate::shape::{Group, GroupGradient, PlaneGradient, add, drawn_only};
use crate::tiles::moment;
use crate::view::{CAMERA_SUMS, View};
use weaver_kernels::Real;
use weaver_kernels::lanes::Lanes;

impl<T: Real> Projector<T> for Rays<T> {
    const SUMS: usize = SUMS;
    type Projected<V: Lanes<Scalar = T>> = Seen<V>;

    #[inline(always)]
    fn project<V: Lanes<Scalar = T>>(&self, view: &View<V>, settings: &RasterSettings, group: &Group<V>) -> Seen<V> {
        see(self, view, settings, group)
    }

    #[inline(always)]
    fn backward<V: Lanes<Scalar = T>>(
        &self,
        (view, settings): (&View<V>, &RasterSettings),
        group: &Group<V>,
        seen: &Seen<V>,
        &Upstream { moments, drawn, dsight }: &Upstream<'_, V>,
        out: &mut GroupGradient<V>,
        camera: &mut [V; CAMERA_SUMS],
    ) {
        macro_rules! here {
            ($x:expr) => {
                drawn_only($x, drawn)
            };
        }
        let Seen { direction, distance: [_, inverse], across, pixel, shape } = seen;
        let PlaneGradient { m: dm, map: dmap, eps: deps } = shape.backward(settings, group, moments, drawn, out);
        let [p, q, r] = shape.factor;

        // A direction that moves by t along the plane moves a ray's place (a, b) by -(t + (a, b) ((a, b) . t)), and
        // with s = L (a, b) sigma by -(L^T s + |s|^2 L^-1 s) . t.
        let first = each!(2, |i| moments[shape_sum::FIRST + i] * V::constant(1.0 / BITS));
        let third = each!(2, |i| moments[THIRD + i] * V::constant(1.0 / (BITS * BITS * BITS)));
        let b = third[1] / r;
        let a = q.neg_mul_add(b, third[0]) / p;
        let mut dplane = [p.mul_add(first[0], a), q.mul_add(first[0], r.mul_add(first[1], b))];
        // M is (e A R diag(s)) / distance; a direction that moves by t takes e by -(e . t) d along.
        let deep = apply_transposed(&shape.rotation, apply_transposed(&view.axes, *direction));
        let deep = each!(3, |j| deep[j] * group.scale[j] * *inverse);
        let dcosine = deps * V::constant(settings.eps2d) * pixel[1];
        for i in 0..2 {
            dplane[i] = dplane[i] - dot(dm[i], deep);
            dplane[i] = dcosine.mul_add(across[i][2], dplane[i]);
        }
        let ddistance = moments[SUMS + moment::DEPTH] - (dot(dm[0], shape.m[0]) + dot(dm[1], shape.m[1])) * *inverse;
        let dpoint = each!(3, |k| {
            let along = across[0][k].mul_add(dplane[0], across[1][k] * dplane[1]);
            along.mul_add(*inverse, direction[k] * ddistance)
        });

        // point = A m + t, and the line of sight m - center.
        let dmean = apply_transposed(&view.axes, dpoint);
        for i in 0..3 {
            for j in 0..3 {
                let daxes = across[0][i].mul_add(dmap[0][j], across[1][i] * dmap[1][j]) * *inverse;
                add(&mut camera[3 * i + j], here!(dpoint[i].mul_add(group.mean[j], daxes)));
            }
            add(&mut camera[9 + i], here!(dpoint[i]));
            add(&mut camera[16 + i], here!(-dsight[i]));
            add(&mut out.mean[i], here!(dmean[i] + dsight[i]));
        }
    }
}
