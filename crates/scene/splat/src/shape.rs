//! Shapes of Gaussians on a plane: their covariance there, and its derivative, sixteen at a time.
//!
//! The covariance on the plane is S = M M^T + eps I with M = J A R diag(s), a 2x3 matrix. Working from M instead of S,
//! nothing cancels: det S = |m1 x m2|^2 + eps (|m1|^2 + |m2|^2) + eps^2 is a sum of positive terms, so that long thin
//! splats are exact in `f32` too.

use crate::columns::{columns, finite};
use crate::each::each;
use crate::ewa::{BITS, moment as shape_sum};
use crate::matrix::{Mat23, Mat33, Vec3, cross, dot, product, product_transposed, transposed_product};
use crate::rotation::{rotation, rotation_backward};
use crate::settings::{RATIO_FLOOR, RasterSettings};
use weaver_kernels::lanes::{LANES, LaneMask, Lanes};
use weaver_scene::GaussianSlices;

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
    pub fn unsound(&self) -> V {
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

/// Gaussians on a plane.
#[derive(Clone, Copy)]
pub(crate) struct Shape<V: Lanes> {
    /// J A, from the world to the plane.
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
    /// Variance of the blur.
    pub eps: V,
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

impl<V: Lanes> Shape<V> {
    /// The shapes on the plane that `map` leads to, blurred by the variance `eps`.
    #[inline(always)]
    pub fn of(map: Mat23<V>, eps: V, settings: &RasterSettings, group: &Group<V>) -> Self {
        let one = V::constant(1.0);
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
        Self {
            map,
            unit,
            inverse_length: inverse / largest,
            rotation,
            m,
            normal,
            eps,
            variance,
            sharp,
            det,
            compensation,
            compensated,
            factor,
        }
    }

    /// Three standard deviations along the longest axis.
    #[inline(always)]
    pub fn three_deviations(&self) -> V {
        let mean = V::constant(0.5) * (self.variance[0] + self.variance[1]);
        let spread = mean.mul_add(mean, -self.det).max(V::zero()).sqrt();
        V::constant(3.0) * (mean + spread).sqrt()
    }
}

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
pub(crate) fn add<V: Lanes>(sum: &mut V, x: V) {
    *sum = *sum + x;
}

/// Gradients of the plane that sixteen shapes lie on.
pub(crate) struct PlaneGradient<V> {
    /// Of M.
    pub m: Mat23<V>,
    /// Of J A.
    pub map: Mat23<V>,
    /// Of the blur's variance.
    pub eps: V,
}

/// The number where it is finite and its Gaussian was drawn, else 0: a Gaussian that was not drawn may have infinite
/// numbers; for drawn ones, an overflow counts as 0.
#[inline(always)]
pub(crate) fn drawn_only<V: Lanes>(x: V, drawn: V::Mask) -> V {
    x.only(finite(x).and(drawn))
}

impl<V: Lanes> Shape<V> {
    /// Adds the gradients of scales, rotations and opacities, from the sums over pixels: of g at
    /// [`G`](shape_sum::G) and of g u^2, g u v, g v^2 from [`SECOND`](shape_sum::SECOND) on.
    #[inline(always)]
    pub fn backward(
        &self,
        settings: &RasterSettings,
        group: &Group<V>,
        moments: &[V; LANES],
        drawn: V::Mask,
        out: &mut GroupGradient<V>,
    ) -> PlaneGradient<V> {
        macro_rules! here {
            ($x:expr) => {
                drawn_only($x, drawn)
            };
        }
        let (one, two) = (V::constant(1.0), V::constant(2.0));
        let inverse_square = V::constant(1.0 / (BITS * BITS));
        let [p, q, r] = self.factor;
        // Opacity, and the compensation that depends on the shape. g = opacity dL/dopacity, compensated.
        let dopacity = moments[shape_sum::G] / (group.opacity * self.compensation);
        add(&mut out.opacity, here!(dopacity * self.compensation));

        // d sigma / d S = -L^T (u v)^T (u v) L / 2 with L = [[p, q], [0, r]], and dS = dM M^T + M dM^T: the gradient of
        // M is L^T G W, G the second moments and W = L M. The rows of W are no longer than 1, however long a needle is;
        // the first, p m1 + q m2, is written without the difference in it.
        let [uu, uv, vv] = each!(3, |i| moments[shape_sum::SECOND + i] * inverse_square);
        let m = &self.m;
        let turned = [cross(m[1], self.normal), cross(self.normal, m[0])];
        let (short, eps) = (p * r * r, self.eps);
        let w: Mat23<V> = [each!(3, |j| short * eps.mul_add(m[0][j], turned[0][j])), each!(3, |j| r * m[1][j])];
        let pulled: Mat23<V> =
            [each!(3, |j| uu.mul_add(w[0][j], uv * w[1][j])), each!(3, |j| uv.mul_add(w[0][j], vv * w[1][j]))];
        let mut dm: Mat23<V> =
            [each!(3, |j| p * pulled[0][j]), each!(3, |j| q.mul_add(pulled[0][j], r * pulled[1][j]))];
        // dL/dS = L^T G L / 2, and the trace of it for S + d eps I.
        let half = V::constant(0.5);
        let mut deps = half * uu.mul_add(p.mul_add(p, q * q), r * (two * uv).mul_add(q, vv * r));
        if settings.antialiased {
            // compensation = sqrt(sharp / det), det = sharp + eps (|m1|^2 + |m2|^2) + eps^2, sharp = |m1 x m2|^2
            let inverse_det = one / self.det;
            let dratio = (dopacity * group.opacity / (two * self.compensation)).only(self.compensated);
            let ddet = -dratio * self.sharp * inverse_det * inverse_det;
            let dsharp = two * dratio.mul_add(inverse_det, ddet);
            let dsquares = two * ddet * eps;
            let squares = self.variance[0] - eps + (self.variance[1] - eps);
            deps = ddet.mul_add(two.mul_add(eps, squares), deps);
            for i in 0..2 {
                for j in 0..3 {
                    dm[i][j] = dsquares.mul_add(m[i][j], dsharp.mul_add(turned[i][j], dm[i][j]));
                }
            }
        }

        // M = (J A) (R diag(s))
        let axes_of_gaussian: Mat33<V> = each!(3, |i| each!(3, |j| self.rotation[i][j] * group.scale[j]));
        let dmap = product_transposed(&dm, &axes_of_gaussian);
        let dproduct = transposed_product(&self.map, &dm);
        let rotation = &self.rotation;
        for j in 0..3 {
            let (a, b) = (each!(3, |i| dproduct[i][j]), each!(3, |i| rotation[i][j]));
            add(&mut out.scale[j], here!(dot(a, b)));
        }
        let drotation: Mat33<V> = each!(3, |i| each!(3, |j| dproduct[i][j] * group.scale[j]));
        let dquat = rotation_backward(self.unit, self.inverse_length, &drotation);
        #[expect(clippy::needless_range_loop, reason = "components in registers, as in every loop here")]
        for i in 0..4 {
            add(&mut out.quat[i], here!(dquat[i]));
        }
        PlaneGradient { m: dm, map: dmap, eps: deps }
    }
}
