//! From a Gaussian in the world to a splat on the image plane.
//!
//! The image covariance is S = M M^T + eps I with M = J A R diag(s), a 2x3 matrix. Working from M instead of S,
//! nothing cancels: det S = |m1 x m2|^2 + eps (|m1|^2 + |m2|^2) + eps^2 is a sum of positive terms, so that long thin
//! splats are exact in `f32` too. The splat itself stores the Cholesky factor of S^-1: in the coordinates
//! u = p dx + q dy, v = r dy it is a unit circle, sigma = (u^2 + v^2) / 2, never negative.

use crate::matrix::{Mat23, Mat33, Vec3, apply, cross, dot, product};
use crate::scene::{ALPHA_MIN, Colour, Gaussians, RATIO_FLOOR, RasterSettings, Viewpoint};
use crate::sh;
use weaver_kernels::Real;

/// A Gaussian as one view sees it: all that compositing needs.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Splat<T> {
    /// Centre, pixels.
    pub x: T,
    /// Centre, pixels.
    pub y: T,
    /// u = p dx + q dy
    pub p: T,
    /// u = p dx + q dy
    pub q: T,
    /// v = r dy
    pub r: T,
    /// Opacity, compensated when antialiased.
    pub opacity: T,
    /// Alpha is below the visible minimum wherever sqrt(u^2 + v^2) exceeds this (rounded up).
    pub reach: T,
    /// Camera z.
    pub z: T,
    /// Colour towards the camera.
    pub colour: Vec3<T>,
}

/// Why a Gaussian has no splat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unseen {
    /// Out of the depth range or too faint.
    Culled,
    /// It holds, or leads to, numbers that are not finite, or its quaternion is zero.
    Rejected,
}

/// One Gaussian's numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gaussian<'a, T> {
    pub mean: Vec3<T>,
    pub quat: [T; 4],
    pub scale: Vec3<T>,
    pub opacity: T,
    pub colour: &'a [T],
}

impl<'a, T: Real> Gaussians<'a, T> {
    /// Gaussian `n`.
    pub(crate) fn get(&self, n: usize) -> Gaussian<'a, T> {
        let three = |values: &[T]| std::array::from_fn(|i| values[3 * n + i]);
        let (values, len) = self.colour.values();
        Gaussian {
            mean: three(self.means),
            quat: std::array::from_fn(|i| self.quats[4 * n + i]),
            scale: three(self.scales),
            opacity: self.opacities[n],
            colour: &values[n * len..(n + 1) * len],
        }
    }
}

impl<T: Real> Gaussian<'_, T> {
    /// Whether all numbers are finite and the quaternion is not zero.
    fn is_sound(&self) -> bool {
        let numbers = [&self.mean[..], &self.quat, &self.scale, &[self.opacity], self.colour];
        numbers.iter().all(|part| part.iter().all(|x| x.is_finite())) && self.quat.iter().any(|&x| x != T::ZERO)
    }
}

/// The unit quaternion along `q` and the length of `q`; `None` for zero. Scaled first, so that nothing overflows.
#[inline(always)]
pub(crate) fn unit_quaternion<T: Real>(q: [T; 4]) -> Option<([T; 4], T)> {
    let largest = q.iter().fold(T::ZERO, |m, x| m.max(x.abs()));
    if largest == T::ZERO {
        return None;
    }
    let q = q.map(|x| x / largest);
    let length = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    Some((q.map(|x| x / length), length * largest))
}

/// The rotation matrix of a unit quaternion wxyz.
#[inline(always)]
pub(crate) fn rotation<T: Real>([w, x, y, z]: [T; 4]) -> Mat33<T> {
    let (one, two) = (T::ONE, T::from_f64(2.0));
    [
        [one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
        [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
        [two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)],
    ]
}

/// Everything between a Gaussian's parameters and its splat's shape; backward computes it anew.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Footprint<T> {
    /// Mean in camera coordinates.
    pub point: Vec3<T>,
    /// x/z and y/z, limited.
    pub slope: [T; 2],
    /// Whether x/z, y/z were beyond their limits.
    pub limited: [bool; 2],
    /// J.
    pub jacobian: Mat23<T>,
    /// J A.
    pub map: Mat23<T>,
    /// Unit quaternion and length of the one given.
    pub unit: ([T; 4], T),
    /// R.
    pub rotation: Mat33<T>,
    /// M = J A R diag(s).
    pub m: Mat23<T>,
    /// m1 x m2.
    pub normal: Vec3<T>,
    /// S yy.
    pub yy: T,
    /// S xx.
    pub xx: T,
    /// det S, S blurred.
    pub det: T,
    /// Factor of the opacity.
    pub compensation: T,
    /// Whether the factor depends on the shape (antialiased and above the floor).
    pub compensated: bool,
    /// p, q, r of the splat.
    pub factor: [T; 3],
}

/// Projects the shape of a Gaussian.
#[inline(always)]
pub(crate) fn footprint<T: Real>(
    view: &Viewpoint<T>,
    settings: &RasterSettings,
    gaussian: &Gaussian<'_, T>,
) -> Result<Footprint<T>, Unseen> {
    let mut point = apply(&view.axes, gaussian.mean);
    (0..3).for_each(|i| point[i] += view.shift[i]);
    let z = point[2];
    if !z.is_finite() {
        return Err(Unseen::Rejected);
    }
    if z < T::from_f64(settings.near) || z > T::from_f64(settings.far) {
        return Err(Unseen::Culled);
    }
    let free: [T; 2] = std::array::from_fn(|i| point[i] / z);
    let limited = std::array::from_fn(|i| free[i] < view.low[i] || free[i] > view.high[i]);
    let slope: [T; 2] = std::array::from_fn(|i| free[i].max(view.low[i]).min(view.high[i]));
    let zoom = view.focal.map(|f| f / z);
    let jacobian = [[zoom[0], T::ZERO, -zoom[0] * slope[0]], [T::ZERO, zoom[1], -zoom[1] * slope[1]]];
    let map = product(&jacobian, &view.axes);
    let unit = unit_quaternion(gaussian.quat).ok_or(Unseen::Rejected)?;
    let rotation = rotation(unit.0);
    let m = product(&map, &rotation).map(|row| std::array::from_fn(|j| row[j] * gaussian.scale[j]));
    let eps = T::from_f64(settings.eps2d);
    let normal = cross(m[0], m[1]);
    let (mxx, myy) = (dot(m[0], m[0]), dot(m[1], m[1]));
    let (xx, yy, xy) = (mxx + eps, myy + eps, dot(m[0], m[1]));
    let sharp = dot(normal, normal);
    let det = sharp + eps * (mxx + myy) + eps * eps;
    let root = det.sqrt();
    let deviation = yy.sqrt();
    let factor = [deviation / root, -xy / (deviation * root), T::ONE / deviation];
    if det <= T::ZERO {
        return Err(Unseen::Culled);
    }
    if !factor.iter().all(|x| x.is_finite()) {
        return Err(Unseen::Rejected);
    }
    let floor = T::from_f64(RATIO_FLOOR);
    let ratio = sharp / det;
    let compensation = if settings.antialiased { ratio.max(floor).sqrt() } else { T::ONE };
    let compensated = settings.antialiased && ratio > floor;
    Ok(Footprint {
        point,
        slope,
        limited,
        jacobian,
        map,
        unit,
        rotation,
        m,
        normal,
        yy,
        xx,
        det,
        compensation,
        compensated,
        factor,
    })
}

/// The splat of a Gaussian in a view.
#[inline(always)]
pub(crate) fn splat<T: Real>(
    view: &Viewpoint<T>,
    settings: &RasterSettings,
    gaussian: &Gaussian<'_, T>,
    colour: &Colour<'_, T>,
) -> Result<Splat<T>, Unseen> {
    if !gaussian.is_sound() {
        return Err(Unseen::Rejected);
    }
    let shape = footprint(view, settings, gaussian)?;
    let opacity = gaussian.opacity * shape.compensation;
    let eps = T::EPSILON.to_f64();
    // Rounded up by more than what the pixels' own arithmetic may be off by: a few units in the last place of
    // p dx and q dy, of which the latter is at most |q| / r times v.
    let limit = 2.0 * (opacity.to_f64() / ALPHA_MIN).ln() + 128.0 * eps;
    if limit.is_nan() || limit < 0.0 {
        return Err(Unseen::Culled);
    }
    let [p, q, r] = shape.factor;
    let reach = T::from_f64(limit.sqrt() * (1.0 + 16.0 * eps * (1.0 + (q / r).abs().to_f64())));
    if settings.radius_clip > 0.0 && three_deviations(&shape) < T::from_f64(settings.radius_clip) {
        return Err(Unseen::Culled);
    }
    let colour = match colour {
        Colour::Plain(_) => [gaussian.colour[0], gaussian.colour[1], gaussian.colour[2]],
        Colour::Sh { degree, .. } => {
            let sight = std::array::from_fn(|i| gaussian.mean[i] - view.centre[i]);
            let sum = sh::colour(*degree, sight, gaussian.colour);
            if !sum.iter().all(|x| x.is_finite()) {
                return Err(Unseen::Rejected);
            }
            sum.map(|c| c.max(T::ZERO))
        }
    };
    let z = shape.point[2];
    let x = view.focal[0] * (shape.point[0] / z) + view.principal[0];
    let y = view.focal[1] * (shape.point[1] / z) + view.principal[1];
    if !(x.is_finite() && y.is_finite() && reach.is_finite()) {
        return Err(Unseen::Rejected);
    }
    Ok(Splat { x, y, p, q, r, opacity, reach, z, colour })
}

/// Three standard deviations along the longest image axis, pixels.
fn three_deviations<T: Real>(shape: &Footprint<T>) -> T {
    let mean = T::from_f64(0.5) * (shape.xx + shape.yy);
    let spread = (mean * mean - shape.det).max(T::ZERO).sqrt();
    T::from_f64(3.0) * (mean + spread).sqrt()
}
