//! Backward of the pinhole projection: from the sums over a splat's pixels to the Gaussian's and the camera's
//! parameters, sixteen Gaussians at a time.

use crate::each::each;
use crate::ewa::{BITS, SUMS, moment as shape_sum};
use crate::matrix::{Vec3, apply_transposed, dot};
use crate::project::Projection;
use crate::settings::RasterSettings;
use crate::shape::{Group, GroupGradient, PlaneGradient, add, drawn_only};
use crate::tiles::moment;
use crate::view::{CAMERA_SUMS, View};
use weaver_kernels::lanes::{LANES, Lanes};

/// Gradients that sixteen splats receive from the pixels.
pub(crate) struct Upstream<'a, V: Lanes> {
    /// Columns of [`moment`]s, zero where a Gaussian was not drawn.
    pub moments: &'a [V; LANES],
    /// The Gaussians that were drawn.
    pub drawn: V::Mask,
    /// The gradient with respect to the line of sight, through the color.
    pub dsight: Vec3<V>,
}

/// Adds the gradients of splats to the gradients of their Gaussians and of the camera.
#[inline(always)]
pub(crate) fn splat_backward<V: Lanes>(
    (view, settings): (&View<V>, &RasterSettings),
    group: &Group<V>,
    projected: &Projection<V>,
    &Upstream { moments, drawn, dsight }: &Upstream<'_, V>,
    out: &mut GroupGradient<V>,
    camera: &mut [V; CAMERA_SUMS],
) {
    macro_rules! here {
        ($x:expr) => {
            drawn_only($x, drawn)
        };
    }
    let inverse = V::constant(1.0 / BITS);
    let [p, q, r] = projected.shape.factor;
    let mut dpoint = [V::zero(), V::zero(), moments[SUMS + moment::DEPTH]];

    let PlaneGradient { map: dmap, .. } = projected.shape.backward(settings, group, moments, drawn, out);

    // J A with J = [[zx, 0, -zx sx], [0, zy, -zy sy]], zoom z = f/Z and slope s; and the center x = fx X/Z + cx.
    let first = each!(2, |i| moments[shape_sum::FIRST + i] * inverse);
    let dcenter = [p * first[0], q.mul_add(first[0], r * first[1])];
    let mut daxes = [[V::zero(); 3]; 3];
    for i in 0..2 {
        let (zoom, slope) = (projected.zoom[i], projected.slope[i]);
        let (diagonal, tilt) = (dot(dmap[i], view.axes[i]), dot(dmap[i], view.axes[2]));
        for j in 0..3 {
            daxes[i][j] = zoom * dmap[i][j];
            daxes[2][j] = slope.neg_mul_add(daxes[i][j], daxes[2][j]);
        }
        let dzoom = tilt.neg_mul_add(slope, diagonal);
        let dbounded = -tilt * zoom;
        // Beyond the limits the slope is a function of the intrinsics.
        let dlimit = (dbounded / view.focal[i]).only(projected.within[i]);
        let dlimit = dbounded / view.focal[i] - dlimit;
        let dslope = dcenter[i].mul_add(view.focal[i], dbounded.only(projected.within[i]));
        let dfocal = dzoom.mul_add(projected.inverse_z, dcenter[i] * projected.free[i]) - dlimit * slope;
        add(&mut camera[12 + i], here!(dfocal));
        add(&mut camera[14 + i], here!(dcenter[i] - dlimit));
        dpoint[i] = dslope * projected.inverse_z;
        let along = dzoom.mul_add(zoom, dslope * projected.free[i]);
        dpoint[2] = along.neg_mul_add(projected.inverse_z, dpoint[2]);
    }

    // point = A m + t, and the line of sight m - center.
    let dmean = apply_transposed(&view.axes, dpoint);
    for i in 0..3 {
        for j in 0..3 {
            add(&mut camera[3 * i + j], here!(dpoint[i].mul_add(group.mean[j], daxes[i][j])));
        }
        add(&mut camera[9 + i], here!(dpoint[i]));
        add(&mut camera[16 + i], here!(-dsight[i]));
        add(&mut out.mean[i], here!(dmean[i] + dsight[i]));
    }
}
