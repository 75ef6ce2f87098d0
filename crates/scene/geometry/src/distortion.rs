//! Lens distortion.

use crate::lens::angles::Angles;
use glam::{DMat2, DVec2};
use std::f64::consts::FRAC_PI_2;

/// Distortion of a pinhole camera's rays by a lens: the image of the point that a pinhole camera of the same intrinsics
/// sees at (x, y), both in coordinates over depth, `(u - cx) / fx` and `(v - cy) / fy`.
///
/// Cropping or resizing a photo changes its intrinsics and leaves its distortion as it is.
///
/// ```
/// use weaver_geometry::{Distortion, glam::DVec2};
///
/// let lens = Distortion::Radial { k: [-0.1, 0.0, 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] };
/// let seen = lens.distort(DVec2::new(0.5, 0.0));
/// assert_eq!(seen, DVec2::new(0.5 * (1.0 - 0.1 * 0.25), 0.0));
/// assert!(lens.undistort(seen).unwrap().distance(DVec2::new(0.5, 0.0)) < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Distortion {
    /// OpenCV's default model. With `r^2 = x^2 + y^2` and `s = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 +
    /// k6 r^6)`, a point goes to `(x s + 2 p1 x y + p2 (r^2 + 2 x^2), y s + p1 (r^2 + 2 y^2) + 2 p2 x y)`.
    Radial {
        /// k1 to k6.
        k: [f64; 6],
        /// p1 and p2, tangential.
        p: [f64; 2],
    },
    /// OpenCV's fisheye model, of Kannala and Brandt. With `r = tan(a)`, a the angle to the optical axis, a point goes
    /// to its direction times `a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8)`.
    Fisheye {
        /// k1 to k4.
        k: [f64; 4],
    },
    /// COLMAP's THIN_PRISM_FISHEYE. With (x, y) the direction times its angle to the axis a, and `a^2 = x^2 + y^2`, a
    /// point goes to `(x s + 2 p1 x y + p2 (a^2 + 2 x^2) + s1 a^2, y s + p1 (a^2 + 2 y^2) + 2 p2 x y + s2 a^2)`, `s = 1
    /// + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8`.
    ThinPrismFisheye {
        /// k1 to k4.
        k: [f64; 4],
        /// p1 and p2, tangential.
        p: [f64; 2],
        /// s1 and s2, of the thin prism.
        s: [f64; 2],
    },
    /// The field-of-view model of Devernay and Faugeras (2001): a point goes to its direction times `atan2(2 tan(w / 2)
    /// sin a, cos a) / w`, a the angle to the optical axis.
    Fov {
        /// w, radians, above 0 and below pi.
        omega: f64,
    },
    /// COLMAP's RAD_TAN_THIN_PRISM_FISHEYE, the lens of Project Aria. With (x, y) the direction times `b = a (1 + k0
    /// a^2 + .. + k5 a^12)`, a the angle to the axis, a point goes to `(x + p0 (b^2 + 2 x^2) + 2 p1 x y + s0 b^2 + s1
    /// b^4, y + p1 (b^2 + 2 y^2) + 2 p0 x y + s2 b^2 + s3 b^4)`.
    RadTanThinPrism {
        /// k0 to k5.
        k: [f64; 6],
        /// p0 and p1, tangential.
        p: [f64; 2],
        /// s0 to s3, of the thin prism.
        s: [f64; 4],
    },
}

/// Angles to the optical axis that are looked at for where a lens folds back.
const ANGLES: usize = 512;
/// Halvings of the range of angles before Newton's steps.
const HALVINGS: usize = 20;
/// Newton's steps; each doubles the number of exact digits.
const STEPS: usize = 10;
/// Largest error of a point, over its distance from the axis plus 1.
const TOLERANCE: f64 = 1e-10;

impl Distortion {
    /// The radial distortion `1 + k1 r^2`.
    pub fn radial(k1: f64) -> Self {
        Self::Radial { k: [k1, 0.0, 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] }
    }

    /// Itself, or `None` where it bends nothing.
    pub fn or_none(self) -> Option<Self> {
        // The field-of-view model tends to a pinhole for small angles, where its formula is 0 / 0.
        let straight = match self {
            Self::Radial { k, p } => k == [0.0; 6] && p == [0.0; 2],
            Self::Fov { omega } => omega.abs() < 1e-6,
            _ => false,
        };
        (!straight).then_some(self)
    }

    /// True if every coefficient is finite.
    pub fn is_finite(&self) -> bool {
        match self {
            Self::Radial { k, p } => k.iter().chain(p).all(|x| x.is_finite()),
            Self::Fisheye { k } => k.iter().all(|x| x.is_finite()),
            Self::ThinPrismFisheye { k, p, s } => k.iter().chain(p).chain(s).all(|x| x.is_finite()),
            Self::Fov { omega } => omega.is_finite(),
            Self::RadTanThinPrism { k, p, s } => k.iter().chain(p).chain(s).all(|x| x.is_finite()),
        }
    }

    /// The image of a point through the lens.
    #[inline]
    pub fn distort(&self, point: DVec2) -> DVec2 {
        if let Some(angles) = self.angles_alone() {
            return angles.project(point.extend(1.0));
        }
        let DVec2 { x, y } = point;
        let (scale, _) = self.scale(point.length_squared());
        let [p1, p2] = self.tangential();
        let r2 = point.length_squared();
        let shift = DVec2::new(2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y);
        point * scale + shift
    }

    /// The point that the lens sees at a place, by Newton's method; `None` where it sees none, as beyond the circle of
    /// a fisheye.
    pub fn undistort(&self, seen: DVec2) -> Option<DVec2> {
        self.undistort_within(seen, self.last_angle())
    }

    /// As [`undistort`](Self::undistort), with the [last angle](Self::last_angle) at hand.
    pub(crate) fn undistort_within(&self, seen: DVec2, last: f64) -> Option<DVec2> {
        if let Some(angles) = self.angles_alone() {
            let ray = angles.ray(seen, last)?;
            return (ray.z > 0.0).then(|| ray.truncate() / ray.z);
        }
        let far = seen.length();
        let (mut low, mut high) = (0.0, last);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            *(if self.bent(middle) < far { &mut low } else { &mut high }) = middle;
        }
        let mut point = seen.normalize_or_zero() * (0.5 * (low + high)).tan();
        for _ in 0..STEPS {
            point -= self.jacobian(point).inverse() * (self.distort(point) - seen);
        }
        // Both are also false for NaN.
        let found = self.distort(point).distance(seen) <= TOLERANCE * (1.0 + far) && point.length() <= last.tan();
        found.then_some(point)
    }

    /// The tangent of the angle to the optical axis up to which the distorted radius grows with the undistorted one.
    /// Beyond it, coefficients that were fitted to a photo say nothing.
    pub fn reach(&self) -> f64 {
        self.last_angle().tan()
    }

    /// The distortion with which a lens of a focal length times `factor` takes the same photo: `d(factor point) /
    /// factor`. `None` for a fisheye, for which no other focal length gives the same photo.
    pub fn refocused(&self, factor: f64) -> Option<Self> {
        let Self::Radial { k, p } = self else { return None };
        let k = std::array::from_fn(|i| k[i] * factor.powi(2 * (i as i32 % 3 + 1)));
        Some(Self::Radial { k, p: p.map(|p| p * factor) })
    }

    /// The formula by angles; `None` for functions of x / z and y / z.
    pub(crate) fn angles(&self) -> Option<Angles> {
        let plain = Angles::EQUIDISTANT;
        let of = |[k1, k2, k3, k4]: [f64; 4]| [k1, k2, k3, k4, 0.0, 0.0];
        Some(match *self {
            Self::Radial { .. } => return None,
            Self::Fisheye { k } => Angles { k: of(k), ..plain },
            Self::ThinPrismFisheye { k, p, s: [s1, s2] } => Angles { k: of(k), p, s: [s1, 0.0, s2, 0.0], ..plain },
            Self::Fov { omega } => Angles { omega: Some(omega), ..plain },
            // Its p0 is the p2 of the others.
            Self::RadTanThinPrism { k, p: [p0, p1], s } => Angles { k, p: [p1, p0], s, after: true, ..plain },
        })
    }

    /// The formula by angles of models that have no other here.
    fn angles_alone(&self) -> Option<Angles> {
        self.angles().filter(|_| !matches!(self, Self::Fisheye { .. }))
    }

    fn tangential(&self) -> [f64; 2] {
        if let Self::Radial { p, .. } = self { *p } else { [0.0; 2] }
    }

    /// The factor on a point whose distance from the axis squared is `r2`, and its derivative by that.
    #[inline]
    fn scale(&self, r2: f64) -> (f64, f64) {
        match self {
            Self::Radial { k: [k1, k2, k3, k4, k5, k6], .. } => {
                let polynomial =
                    |[a, b, c]: [f64; 3]| (1.0 + r2 * (a + r2 * (b + r2 * c)), a + r2 * (2.0 * b + r2 * 3.0 * c));
                let (n, dn) = polynomial([*k1, *k2, *k3]);
                let (d, dd) = polynomial([*k4, *k5, *k6]);
                (n / d, (dn * d - n * dd) / (d * d))
            }
            Self::Fisheye { k: [k1, k2, k3, k4] } => {
                let r = r2.sqrt();
                // The limit at the axis, where the expression below is 0 / 0.
                if r < 1e-4 {
                    let slope = k1 - 1.0 / 3.0;
                    return (1.0 + slope * r2, slope);
                }
                let a = r.atan();
                let a2 = a * a;
                let bent = a * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))));
                let slope = 1.0 + a2 * (3.0 * k1 + a2 * (5.0 * k2 + a2 * (7.0 * k3 + a2 * 9.0 * k4)));
                (bent / r, (slope / (1.0 + r2) - bent / r) / (2.0 * r2))
            }
            _ => (1.0, 0.0),
        }
    }

    /// Distance from the axis of a point at an angle to it, but for the tangential part.
    fn bent(&self, angle: f64) -> f64 {
        let r = angle.tan();
        r * self.scale(r * r).0
    }

    /// The largest angle below a right one up to which [`bent`](Self::bent) grows.
    pub(crate) fn last_angle(&self) -> f64 {
        if let Some(angles) = self.angles_alone() {
            return angles.last_angle().min(FRAC_PI_2 * (ANGLES - 1) as f64 / ANGLES as f64);
        }
        let angle = |i: usize| FRAC_PI_2 * i as f64 / ANGLES as f64;
        let grows = |i: &usize| {
            let r2 = angle(*i).tan().powi(2);
            let (scale, slope) = self.scale(r2);
            // Beyond a zero of the denominator, the factor is negative.
            scale > 0.0 && scale + 2.0 * r2 * slope > 0.0
        };
        angle((1..ANGLES).take_while(grows).last().unwrap_or(0))
    }

    /// The derivative of [`distort`](Self::distort).
    pub(crate) fn jacobian(&self, point: DVec2) -> DMat2 {
        let DVec2 { x, y } = point;
        let (scale, slope) = self.scale(point.length_squared());
        let [p1, p2] = self.tangential();
        let outer = DMat2::from_cols(point * x, point * y) * (2.0 * slope);
        let mixed = 2.0 * (p1 * x + p2 * y);
        let tangential =
            DMat2::from_cols_array(&[2.0 * p1 * y + 6.0 * p2 * x, mixed, mixed, 6.0 * p1 * y + 2.0 * p2 * x]);
        DMat2::from_diagonal(DVec2::splat(scale)) + outer + tangential
    }
}
