//! The fisheye lens: projection, its inverse and its derivatives.

use weaver_geometry::glam::{DVec2, DVec3};

/// Numbers of a lens that are adjusted: the logarithm of the focal length, the principal point over the longer side,
/// and k1 to k4.
pub(super) const NUMBERS: usize = 7;
/// Derivatives of a coordinate of a pixel: by the point in camera coordinates, and by the numbers of the lens.
type Row = ([f64; 3], [f64; NUMBERS]);
/// Newton's steps of the inverse, and halvings before them.
const STEPS: usize = 20;
/// Angles at which growth of the radius is checked.
const ANGLES: usize = 360;
/// Distance from the axis, over that from the camera, below which a point is on the axis.
const ON_AXIS: f64 = 1e-9;

/// OpenCV's fisheye model by angles: a point at angle a to the axis is seen at distance `f a (1 + k1 a^2 + k2 a^4 + k3
/// a^6 + k4 a^8)` from the principal point, also beside and behind the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FisheyeLens {
    /// Focal length, pixels for a radian.
    pub focal: f64,
    /// Principal point, pixels.
    pub center: DVec2,
    /// k1 to k4.
    pub k: [f64; 4],
    /// Longer side of the photo, pixels.
    pub longer: f64,
}

impl FisheyeLens {
    /// An equidistant lens with this focal length for photos of this size (height, width).
    pub fn new([height, width]: [usize; 2], focal: f64) -> Self {
        let center = DVec2::new(width as f64 / 2.0, height as f64 / 2.0);
        Self { focal, center, k: [0.0; 4], longer: width.max(height) as f64 }
    }

    /// An equidistant lens with this field of view across the longer side, degrees.
    pub fn across(size: [usize; 2], degrees: f64) -> Self {
        Self::new(size, size[0].max(size[1]) as f64 / degrees.to_radians())
    }

    /// Distance from the principal point over the focal length at an angle to the axis, and its derivative.
    fn bent(&self, angle: f64) -> (f64, f64) {
        let [k1, k2, k3, k4] = self.k;
        let a2 = angle * angle;
        let radius = angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))));
        let slope = 1.0 + a2 * (3.0 * k1 + a2 * (5.0 * k2 + a2 * (7.0 * k3 + a2 * 9.0 * k4)));
        (radius, slope)
    }

    /// The largest angle, up to pi, up to which the radius grows.
    pub fn last_angle(&self) -> f64 {
        let angle = |i: usize| std::f64::consts::PI * i as f64 / ANGLES as f64;
        angle((1..=ANGLES).take_while(|i| self.bent(angle(*i)).1 > 0.0).last().unwrap_or(0))
    }

    /// The pixel of a point in camera coordinates; `None` in the middle of the camera, and beyond the angle at which
    /// the radius stops growing.
    pub fn project(&self, p: DVec3) -> Option<DVec2> {
        let far = p.length();
        let beside = p.truncate().length();
        let angle = beside.atan2(p.z);
        if far == 0.0 || angle > self.last_angle() {
            return None;
        }
        let factor = if beside > ON_AXIS * far { self.bent(angle).0 / beside } else { 1.0 / p.z };
        Some(self.center + p.truncate() * (self.focal * factor))
    }

    /// The direction that is seen at a pixel, of length 1; `None` beyond the last angle.
    pub fn ray(&self, pixel: DVec2) -> Option<DVec3> {
        let at = (pixel - self.center) / self.focal;
        let far = at.length();
        let last = self.last_angle();
        if far > self.bent(last).0 {
            return None;
        }
        let (mut low, mut high) = (0.0, last);
        let mut angle = far.min(last);
        for _ in 0..STEPS {
            let (radius, slope) = self.bent(angle);
            *(if radius < far { &mut low } else { &mut high }) = angle;
            let next = angle - (radius - far) / slope;
            if (next - angle).abs() <= 4.0 * f64::EPSILON * angle {
                break;
            }
            angle = if next > low && next < high { next } else { 0.5 * (low + high) };
        }
        let (sin, cos) = angle.sin_cos();
        Some((at.normalize_or_zero() * sin).extend(cos))
    }

    /// The pixel of a point, and the derivatives of both coordinates: by the point, then by the numbers of the lens.
    /// `None` as for [`project`](Self::project).
    pub(super) fn linearized(&self, p: DVec3) -> Option<(DVec2, [Row; 2])> {
        let at = self.project(p)?;
        let beside = p.truncate().length();
        let square = p.length_squared();
        let f = self.focal;
        let (radius, slope) = self.bent(beside.atan2(p.z));
        let angle = beside.atan2(p.z);
        // The factor on x and y, and its derivatives by the distance from the axis, over that, and by depth.
        let (factor, across, along) = if beside > ON_AXIS * p.length() {
            let factor = radius / beside;
            let by_beside = (slope * p.z / square - factor) / beside;
            (factor, by_beside / beside, -slope / square)
        } else {
            (1.0 / p.z, 0.0, -1.0 / (p.z * p.z))
        };
        let derivatives = |i: usize| {
            let (own, other) = (p[i], p[1 - i]);
            let mut by_point = [0.0; 3];
            by_point[i] = f * (factor + own * own * across);
            by_point[1 - i] = f * own * other * across;
            by_point[2] = f * own * along;
            let mut by_lens = [0.0; NUMBERS];
            by_lens[0] = f * own * factor;
            by_lens[1 + i] = self.longer;
            let direction = if beside > 0.0 { own / beside } else { 0.0 };
            (0..4).for_each(|k| by_lens[3 + k] = f * direction * angle.powi(2 * k as i32 + 3));
            (by_point, by_lens)
        };
        Some((at, [derivatives(0), derivatives(1)]))
    }

    /// The lens with its numbers moved.
    pub(super) fn moved(&self, by: &[f64]) -> Self {
        Self {
            focal: self.focal * by[0].exp(),
            center: self.center + DVec2::new(by[1], by[2]) * self.longer,
            k: std::array::from_fn(|i| self.k[i] + by[3 + i]),
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lens(k: [f64; 4]) -> FisheyeLens {
        FisheyeLens { k, center: DVec2::new(310.0, 247.0), ..FisheyeLens::new([480, 640], 180.0) }
    }

    proptest! {
        /// A ray goes to its pixel and back, up to angles beyond a right one.
        #[test]
        fn rays_are_the_inverse_of_projecting(
            k1 in -0.05..0.05f64, k2 in -0.01..0.01f64, angle in 0.0..1.9f64, around in 0.0..6.0f64, far in 0.1..100.0f64,
        ) {
            let lens = lens([k1, k2, 0.0005, -0.0001]);
            let ray = DVec3::new(angle.sin() * around.cos(), angle.sin() * around.sin(), angle.cos());
            prop_assume!(angle < 0.98 * lens.last_angle());
            let back = lens.ray(lens.project(ray * far).unwrap()).unwrap();
            prop_assert!(back.distance(ray) < 1e-9, "{back} of {ray}");
        }

        /// Derivatives beside differences of the fourth order.
        #[test]
        fn derivatives_are_those_of_the_projection(
            k1 in -0.05..0.05f64, k2 in -0.01..0.01f64, x in -3.0..3.0f64, y in -3.0..3.0f64, z in -1.0..3.0f64,
        ) {
            let lens = lens([k1, k2, 0.0004, -0.0001]);
            let p = DVec3::new(x, y, z);
            prop_assume!(p.length() > 0.3 && p.truncate().length() > 0.05);
            prop_assume!(p.truncate().length().atan2(p.z) < 0.9 * lens.last_angle());
            let (at, rows) = lens.linearized(p).unwrap();
            prop_assert_eq!(at, lens.project(p).unwrap());
            let h = 1e-4;
            let slope = |of: &dyn Fn(f64) -> DVec2| {
                (8.0 * (of(h) - of(-h)) - (of(2.0 * h) - of(-2.0 * h))) / (12.0 * h)
            };
            for k in 0..3 {
                let unit = DVec3::from_array(std::array::from_fn(|i| f64::from(i == k)));
                let expected = slope(&|by| lens.project(p + unit * by).unwrap());
                for i in 0..2 {
                    prop_assert!((rows[i].0[k] - expected[i]).abs() < 1e-5 * (1.0 + expected[i].abs()), "{i}, {k}");
                }
            }
            for k in 0..NUMBERS {
                let by = |by: f64| lens.moved(&std::array::from_fn::<f64, NUMBERS, _>(|i| if i == k { by } else { 0.0 }));
                // A lens with other coefficients may end before the point.
                prop_assume!([-2.0, 2.0].iter().all(|times| by(times * h).project(p).is_some()));
                let expected = slope(&|x| by(x).project(p).unwrap());
                for i in 0..2 {
                    prop_assert!((rows[i].1[k] - expected[i]).abs() < 1e-5 * (1.0 + expected[i].abs()), "{i}, lens {k}");
                }
            }
        }
    }

    #[test]
    fn a_point_ahead_is_on_the_principal_point() {
        let lens = lens([0.01, 0.0, 0.0, 0.0]);
        assert_eq!(lens.project(DVec3::Z * 3.0), Some(lens.center));
        assert_eq!(lens.ray(lens.center), Some(DVec3::Z));
        assert!(lens.linearized(DVec3::Z).is_some_and(|(_, rows)| rows[0].0[0] == 180.0));
        assert_eq!(lens.project(DVec3::ZERO), None);
    }
}
