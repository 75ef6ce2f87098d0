//! Backward of projection: from the sums over a splat's pixels to the Gaussian's and the camera's parameters.

use crate::matrix::{Mat23, Mat33, Vec3, apply_transposed, cross, dot, product_transposed, transposed_product};
use crate::project::{Footprint, Gaussian, Splat};
use crate::scene::{Colour, RasterSettings, Viewpoint};
use crate::sh;
use weaver_kernels::Real;

/// Sums over the pixels of a splat, g = alpha dL/dalpha where alpha is not capped, w = alpha T.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moments<T> {
    /// sum g
    pub g: T,
    /// sum g u, sum g v
    pub first: [T; 2],
    /// sum g u^2, sum g u v, sum g v^2
    pub second: [T; 3],
    /// sum w dimage
    pub colour: Vec3<T>,
    /// sum w ddepth
    pub z: T,
    /// sum |dL/dx|, sum |dL/dy| of the centre
    pub absolute: [T; 2],
}

/// Numbers in the flat form of [`Moments`].
pub(crate) const MOMENTS: usize = 12;

impl<T: Real> Moments<T> {
    /// Sums rows of [`MOMENTS`] numbers, in order.
    pub fn sum<'a>(rows: impl Iterator<Item = &'a [T]>) -> Self {
        let mut s = [T::ZERO; MOMENTS];
        for row in rows {
            for (s, x) in s.iter_mut().zip(row) {
                *s += *x;
            }
        }
        Self {
            g: s[0],
            first: [s[1], s[2]],
            second: [s[3], s[4], s[5]],
            colour: [s[6], s[7], s[8]],
            z: s[9],
            absolute: [s[10], s[11]],
        }
    }
}

/// Gradients of one Gaussian but for its colour.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GaussianGradient<T> {
    pub mean: Vec3<T>,
    pub quat: [T; 4],
    pub scale: Vec3<T>,
    pub opacity: T,
}

impl<T: Real> GaussianGradient<T> {
    /// Nothing.
    pub const ZERO: Self = Self { mean: [T::ZERO; 3], quat: [T::ZERO; 4], scale: [T::ZERO; 3], opacity: T::ZERO };
}

/// Gradients of a camera's axes (9), shift (3), focal lengths (2), principal point (2) and centre (3).
pub(crate) const CAMERA_SUMS: usize = 19;

/// Adds the gradients of one splat to those of its Gaussian and of the camera, and calls `dcolour(k, channel, value)`
/// for each colour parameter.
#[inline(always)]
pub(crate) fn splat_backward<T: Real>(
    view: &Viewpoint<T>,
    settings: &RasterSettings,
    gaussian: &Gaussian<'_, T>,
    colour: &Colour<'_, T>,
    (splat, shape, moments): (&Splat<T>, &Footprint<T>, &Moments<T>),
    out: &mut GaussianGradient<T>,
    camera: &mut [T],
    mut dcolour: impl FnMut(usize, usize, T),
) {
    let two = T::from_f64(2.0);
    let [p, q, r] = shape.factor;
    let z = shape.point[2];
    let mut dpoint = [T::ZERO, T::ZERO, moments.z];

    // Opacity, and the compensation that depends on the shape.
    let dopacity = moments.g / splat.opacity;
    out.opacity += dopacity * shape.compensation;

    // d sigma / d S = -L^T (u v)^T (u v) L / 2 with L = [[p, q], [0, r]], and dS = dM M^T + M dM^T.
    let [uu, uv, vv] = moments.second;
    let dxx = p * p * uu;
    let dxy = p * (q * uu + r * uv);
    let dyy = q * q * uu + two * q * r * uv + r * r * vv;
    let mut dm: Mat23<T> = [
        std::array::from_fn(|j| dxx * shape.m[0][j] + dxy * shape.m[1][j]),
        std::array::from_fn(|j| dxy * shape.m[0][j] + dyy * shape.m[1][j]),
    ];
    if shape.compensated {
        // compensation = sqrt(sharp / det), det = sharp + eps (|m1|^2 + |m2|^2) + eps^2, sharp = |m1 x m2|^2
        let sharp = dot(shape.normal, shape.normal);
        let dratio = dopacity * gaussian.opacity / (two * shape.compensation);
        let ddet = -dratio * sharp / (shape.det * shape.det);
        let dsharp = dratio / shape.det + ddet;
        let dsquares = ddet * T::from_f64(settings.eps2d);
        let turned = [cross(shape.m[1], shape.normal), cross(shape.normal, shape.m[0])];
        for i in 0..2 {
            for j in 0..3 {
                dm[i][j] += two * (dsquares * shape.m[i][j] + dsharp * turned[i][j]);
            }
        }
    }

    // M = (J A) (R diag(s))
    let axes_of_gaussian: Mat33<T> = shape.rotation.map(|row| std::array::from_fn(|j| row[j] * gaussian.scale[j]));
    let dmap = product_transposed(&dm, &axes_of_gaussian);
    let dproduct = transposed_product(&shape.map, &dm);
    for j in 0..3 {
        out.scale[j] += (0..3).map(|i| dproduct[i][j] * shape.rotation[i][j]).sum();
    }
    let drotation: Mat33<T> = dproduct.map(|row| std::array::from_fn(|j| row[j] * gaussian.scale[j]));
    let dquat = rotation_backward(shape.unit, &drotation);
    (0..4).for_each(|i| out.quat[i] += dquat[i]);

    // J A
    let djacobian = product_transposed(&dmap, &view.axes);
    let mut daxes = transposed_product(&shape.jacobian, &dmap);

    // J, and the centre x = fx X/Z + cx.
    let dcentre = [p * moments.first[0], q * moments.first[0] + r * moments.first[1]];
    for i in 0..2 {
        let zoom = shape.jacobian[i][i];
        let (diagonal, tilt) = (djacobian[i][i], djacobian[i][2]);
        let slope = shape.point[i] / z;
        let mut dfocal = (diagonal - tilt * shape.slope[i]) / z + dcentre[i] * slope;
        let mut dprincipal = dcentre[i];
        dpoint[2] -= (diagonal - tilt * shape.slope[i]) * zoom / z;
        let mut dslope = dcentre[i] * view.focal[i];
        let dbounded = -tilt * zoom;
        if shape.limited[i] {
            dfocal -= dbounded * shape.slope[i] / view.focal[i];
            dprincipal -= dbounded / view.focal[i];
        } else {
            dslope += dbounded;
        }
        dpoint[i] += dslope / z;
        dpoint[2] -= dslope * slope / z;
        camera[12 + i] += dfocal;
        camera[14 + i] += dprincipal;
    }

    // The colour, through the line of sight.
    let mut dmean = apply_transposed(&view.axes, dpoint);
    match colour {
        Colour::Plain(_) => (0..3).for_each(|channel| dcolour(0, channel, moments.colour[channel])),
        Colour::Sh { degree, .. } => {
            let visible = std::array::from_fn(|i| if splat.colour[i] > T::ZERO { moments.colour[i] } else { T::ZERO });
            let sight = std::array::from_fn(|i| gaussian.mean[i] - view.centre[i]);
            let dsight = sh::colour_backward(*degree, sight, gaussian.colour, visible, |k, basis| {
                (0..3).for_each(|channel| dcolour(k, channel, visible[channel] * basis));
            });
            for i in 0..3 {
                dmean[i] += dsight[i];
                camera[16 + i] -= dsight[i];
            }
        }
    }

    // point = A m + t
    for i in 0..3 {
        for j in 0..3 {
            daxes[i][j] += dpoint[i] * gaussian.mean[j];
            camera[3 * i + j] += daxes[i][j];
        }
        camera[9 + i] += dpoint[i];
        out.mean[i] += dmean[i];
    }
}

/// Backward of the rotation matrix of a quaternion, through its normalisation.
#[inline(always)]
pub(crate) fn rotation_backward<T: Real>((unit, length): ([T; 4], T), d: &Mat33<T>) -> [T; 4] {
    let two = T::from_f64(2.0);
    let [w, x, y, z] = unit;
    let dunit = [
        two * (x * (d[2][1] - d[1][2]) + y * (d[0][2] - d[2][0]) + z * (d[1][0] - d[0][1])),
        two * (w * (d[2][1] - d[1][2]) + y * (d[0][1] + d[1][0]) + z * (d[0][2] + d[2][0])
            - two * x * (d[1][1] + d[2][2])),
        two * (w * (d[0][2] - d[2][0]) + x * (d[0][1] + d[1][0]) + z * (d[1][2] + d[2][1])
            - two * y * (d[0][0] + d[2][2])),
        two * (w * (d[1][0] - d[0][1]) + x * (d[0][2] + d[2][0]) + y * (d[1][2] + d[2][1])
            - two * z * (d[0][0] + d[1][1])),
    ];
    let along = (0..4).map(|i| unit[i] * dunit[i]).sum::<T>();
    std::array::from_fn(|i| (dunit[i] - unit[i] * along) / length)
}

/// Gradients of view matrix (12, row-major) and intrinsics (4) from the sums over all splats: the centre is -A^-1 t.
pub(crate) fn camera_gradient<T: Real>(view: &Viewpoint<T>, sums: &[T]) -> ([T; 12], [T; 4]) {
    let dcentre: Vec3<f64> = std::array::from_fn(|i| sums[16 + i].to_f64());
    // Plain colours do not look at the centre, which need not exist then.
    let moved = if dcentre == [0.0; 3] { [0.0; 3] } else { apply_transposed(&view.inverse, dcentre) };
    let mut matrix = [T::ZERO; 12];
    for i in 0..3 {
        for j in 0..3 {
            let through_centre = if moved[i] == 0.0 { 0.0 } else { moved[i] * view.centre[j].to_f64() };
            matrix[4 * i + j] = sums[3 * i + j] - T::from_f64(through_centre);
        }
        matrix[4 * i + 3] = sums[9 + i] - T::from_f64(moved[i]);
    }
    (matrix, [sums[12], sums[13], sums[14], sums[15]])
}
