//! Backward of projection: from the sums over a splat's pixels to the Gaussian's and the camera's parameters, sixteen
//! Gaussians at a time.

use crate::columns::finite;
use crate::each::each;
use crate::ewa::{BITS, SUMS, moment as shape_sum};
use crate::matrix::{Mat23, Mat33, Vec3, apply_transposed, cross, dot, product_transposed, transposed_product};
use crate::project::{Group, Projection};
use crate::rotation::rotation_backward;
use crate::settings::RasterSettings;
use crate::tiles::moment;
use crate::view::{CAMERA_SUMS, View};
use weaver_kernels::lanes::{LANES, LaneMask, Lanes};

/// Gradients of sixteen Gaussians but for their colors.
#[derive(Clone, Copy)]
pub(crate) struct GroupGradient<V> {
    pub mean: Vec3<V>,
    pub quat: [V; 4],
    pub scale: Vec3<V>,
    pub opacity: V,
}

impl<V: Lanes> GroupGradient<V> {
    /// Gradients of zero.
    #[inline(always)]
    pub fn zero() -> Self {
        let zero = V::zero();
        Self { mean: [zero; 3], quat: [zero; 4], scale: [zero; 3], opacity: zero }
    }
}

#[inline(always)]
fn add<V: Lanes>(sum: &mut V, x: V) {
    *sum = *sum + x;
}

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
    shape: &Projection<V>,
    &Upstream { moments, drawn, dsight }: &Upstream<'_, V>,
    out: &mut GroupGradient<V>,
    camera: &mut [V; CAMERA_SUMS],
) {
    let (one, two) = (V::constant(1.0), V::constant(2.0));
    // A Gaussian that was not drawn may have infinite numbers; for drawn ones, an overflow counts as 0.
    macro_rules! here {
        ($x:expr) => {{
            let x = $x;
            x.only(finite(x).and(drawn))
        }};
    }
    let (inverse, inverse_square) = (V::constant(1.0 / BITS), V::constant(1.0 / (BITS * BITS)));
    let [p, q, r] = shape.factor;
    let mut dpoint = [V::zero(), V::zero(), moments[SUMS + moment::DEPTH]];

    // Opacity, and the compensation that depends on the shape. g = opacity dL/dopacity, compensated.
    let dopacity = moments[shape_sum::G] / (group.opacity * shape.compensation);
    add(&mut out.opacity, here!(dopacity * shape.compensation));

    // d sigma / d S = -L^T (u v)^T (u v) L / 2 with L = [[p, q], [0, r]], and dS = dM M^T + M dM^T: the gradient of M
    // is L^T G W, G the second moments and W = L M. The rows of W are no longer than 1, however long a needle is; the
    // first, p m1 + q m2, is written without the difference in it.
    let [uu, uv, vv] = each!(3, |i| moments[shape_sum::SECOND + i] * inverse_square);
    let m = &shape.m;
    let turned = [cross(m[1], shape.normal), cross(shape.normal, m[0])];
    let (short, eps) = (p * r * r, V::constant(settings.eps2d));
    let w: Mat23<V> = [each!(3, |j| short * eps.mul_add(m[0][j], turned[0][j])), each!(3, |j| r * m[1][j])];
    let pulled: Mat23<V> =
        [each!(3, |j| uu.mul_add(w[0][j], uv * w[1][j])), each!(3, |j| uv.mul_add(w[0][j], vv * w[1][j]))];
    let mut dm: Mat23<V> = [each!(3, |j| p * pulled[0][j]), each!(3, |j| q.mul_add(pulled[0][j], r * pulled[1][j]))];
    if settings.antialiased {
        // compensation = sqrt(sharp / det), det = sharp + eps (|m1|^2 + |m2|^2) + eps^2, sharp = |m1 x m2|^2
        let inverse_det = one / shape.det;
        let dratio = (dopacity * group.opacity / (two * shape.compensation)).only(shape.compensated);
        let ddet = -dratio * shape.sharp * inverse_det * inverse_det;
        let dsharp = two * dratio.mul_add(inverse_det, ddet);
        let dsquares = two * ddet * eps;
        for i in 0..2 {
            for j in 0..3 {
                dm[i][j] = dsquares.mul_add(m[i][j], dsharp.mul_add(turned[i][j], dm[i][j]));
            }
        }
    }

    // M = (J A) (R diag(s))
    let axes_of_gaussian: Mat33<V> = each!(3, |i| each!(3, |j| shape.rotation[i][j] * group.scale[j]));
    let dmap = product_transposed(&dm, &axes_of_gaussian);
    let dproduct = transposed_product(&shape.map, &dm);
    let rotation = &shape.rotation;
    for j in 0..3 {
        let (a, b) = (each!(3, |i| dproduct[i][j]), each!(3, |i| rotation[i][j]));
        add(&mut out.scale[j], here!(dot(a, b)));
    }
    let drotation: Mat33<V> = each!(3, |i| each!(3, |j| dproduct[i][j] * group.scale[j]));
    let dquat = rotation_backward(shape.unit, shape.inverse_length, &drotation);
    #[expect(clippy::needless_range_loop, reason = "components in registers, as in every loop here")]
    for i in 0..4 {
        add(&mut out.quat[i], here!(dquat[i]));
    }

    // J A with J = [[zx, 0, -zx sx], [0, zy, -zy sy]], zoom z = f/Z and slope s; and the center x = fx X/Z + cx.
    let first = each!(2, |i| moments[shape_sum::FIRST + i] * inverse);
    let dcenter = [p * first[0], q.mul_add(first[0], r * first[1])];
    let mut daxes = [[V::zero(); 3]; 3];
    for i in 0..2 {
        let (zoom, slope) = (shape.zoom[i], shape.slope[i]);
        let (diagonal, tilt) = (dot(dmap[i], view.axes[i]), dot(dmap[i], view.axes[2]));
        for j in 0..3 {
            daxes[i][j] = zoom * dmap[i][j];
            daxes[2][j] = slope.neg_mul_add(daxes[i][j], daxes[2][j]);
        }
        let dzoom = tilt.neg_mul_add(slope, diagonal);
        let dbounded = -tilt * zoom;
        // Beyond the limits the slope is a function of the intrinsics.
        let dlimit = (dbounded / view.focal[i]).only(shape.within[i]);
        let dlimit = dbounded / view.focal[i] - dlimit;
        let dslope = dcenter[i].mul_add(view.focal[i], dbounded.only(shape.within[i]));
        let dfocal = dzoom.mul_add(shape.inverse_z, dcenter[i] * shape.free[i]) - dlimit * slope;
        add(&mut camera[12 + i], here!(dfocal));
        add(&mut camera[14 + i], here!(dcenter[i] - dlimit));
        dpoint[i] = dslope * shape.inverse_z;
        let along = dzoom.mul_add(zoom, dslope * shape.free[i]);
        dpoint[2] = along.neg_mul_add(shape.inverse_z, dpoint[2]);
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
