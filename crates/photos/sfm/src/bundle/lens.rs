//! Lenses: the parameters that several cameras share.

use super::longer;
use weaver_geometry::Camera;
use weaver_geometry::glam::{DVec2, DVec3};

/// Newton's steps of [`Lens::undistort`]; each doubles the number of exact digits.
const STEPS: usize = 20;

/// Lens that several cameras share.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lens {
    /// Logarithm of a factor of the focal lengths.
    pub log_focal: f64,
    /// Radial distortion: a point at distance r from the axis, over its depth, is seen at `r (1 + k1 r^2 + k2 r^4)`.
    pub k1: f64,
    /// The second coefficient of the distortion.
    pub k2: f64,
    /// Shift of the principal point from the cameras' own, over the longer sides of their photos.
    pub shift: DVec2,
    /// Expected value of [`log_focal`](Self::log_focal).
    pub expected: f64,
    /// Weight of the square of the difference from the expected value, squared pixels.
    pub weight: f64,
    /// Weight of the squares of [`k1`](Self::k1) and [`k2`](Self::k2), squared pixels.
    pub distortion_weight: f64,
    /// Weight of the square of the [`shift`](Self::shift), squared pixels.
    pub shift_weight: f64,
    /// True if the factor is adjusted.
    pub free_focal: bool,
    /// True if the first coefficient of the distortion is adjusted.
    pub free_k1: bool,
    /// True if the second coefficient of the distortion is adjusted.
    pub free_k2: bool,
    /// True if the principal point is adjusted.
    pub free_shift: bool,
}

impl Lens {
    /// The pixel of a point of camera coordinates in a camera with this lens.
    pub fn project(&self, camera: &Camera, p: DVec3) -> DVec2 {
        let k = &camera.intrinsics;
        let at = DVec2::new(p.x, p.y) / p.z;
        let r2 = at.length_squared();
        let scale = self.log_focal.exp() * (1.0 + r2 * (self.k1 + r2 * self.k2));
        DVec2::new(k.fx * at.x, k.fy * at.y) * scale + self.center(camera)
    }

    /// The pixel of an ideal pinhole camera of the same focal length and principal point for a pixel of a camera with
    /// this lens, by Newton's method on the distance from the axis.
    ///
    /// Where the lens folds back, so that several points or none project to the pixel, it is the nearest pixel before
    /// the fold. [`project`](Self::project) is the inverse elsewhere.
    pub fn undistort(&self, camera: &Camera, pixel: DVec2) -> DVec2 {
        if self.k1 == 0.0 && self.k2 == 0.0 {
            return pixel;
        }
        let (center, factor) = (self.center(camera), self.log_focal.exp());
        let focal = DVec2::new(camera.intrinsics.fx, camera.intrinsics.fy) * factor;
        let seen = (pixel - center) / focal;
        let far = seen.length();
        if far == 0.0 {
            return pixel;
        }
        let bent = |r: f64| r * (1.0 + r * r * (self.k1 + r * r * self.k2));
        let (mut low, mut high) = (0.0, self.fold());
        // Beyond the fold there is no solution; without a fold, the upper bound has to be searched.
        if high.is_finite() && bent(high) <= far {
            return center + seen * (high / far) * focal;
        }
        let mut r = far.min(high);
        for _ in 0..STEPS {
            let off = bent(r) - far;
            *(if off < 0.0 { &mut low } else { &mut high }) = r;
            let slope = 1.0 + r * r * (3.0 * self.k1 + 5.0 * r * r * self.k2);
            let next = r - off / slope;
            if (next - r).abs() <= 2.0 * f64::EPSILON * r {
                break;
            }
            // Newton's step if it stays between the bounds.
            r = if next > low && next < high {
                next
            } else if high.is_finite() {
                0.5 * (low + high)
            } else {
                2.0 * low
            };
        }
        center + seen * (r / far) * focal
    }

    /// The least distance from the axis, over the depth, beyond which the projection no longer moves outward; infinite
    /// if none.
    fn fold(&self) -> f64 {
        // The least positive root s = r^2 of 1 + 3 k1 s + 5 k2 s^2.
        let (a, b) = (5.0 * self.k2, 3.0 * self.k1);
        let inside = b * b - 4.0 * a;
        if inside < 0.0 {
            return f64::INFINITY;
        }
        // In this form neither root is a difference of nearly equal numbers for long, and a = 0 needs no case of its
        // own.
        let root = inside.sqrt();
        let roots = [-2.0 / (b + root), -2.0 / (b - root)];
        roots.into_iter().filter(|s| *s > 0.0).fold(f64::INFINITY, f64::min).sqrt()
    }

    /// The principal point of a camera with this lens, pixels.
    pub(crate) fn center(&self, camera: &Camera) -> DVec2 {
        DVec2::new(camera.intrinsics.cx, camera.intrinsics.cy) + self.shift * longer(camera)
    }

    /// The same lens with all numbers fixed.
    pub(crate) fn held(self) -> Self {
        Self { free_focal: false, free_k1: false, free_k2: false, free_shift: false, ..self }
    }

    /// True for its [numbers](Self::numbers) that are adjusted.
    pub(super) fn free(&self) -> [bool; NUMBERS] {
        [self.free_focal, self.free_k1, self.free_k2, self.free_shift, self.free_shift]
    }

    /// The adjustable numbers.
    pub(super) fn numbers(&self) -> [f64; NUMBERS] {
        [self.log_focal, self.k1, self.k2, self.shift.x, self.shift.y]
    }

    /// The weight of each number, and its difference from the expected value; no weight if it is not free.
    pub(super) fn priors(&self) -> [(f64, f64); NUMBERS] {
        let weights =
            [self.weight, self.distortion_weight, self.distortion_weight, self.shift_weight, self.shift_weight];
        let (free, numbers) = (self.free(), self.numbers());
        std::array::from_fn(|i| {
            let expected = if i == 0 { self.expected } else { 0.0 };
            (if free[i] { weights[i] } else { 0.0 }, numbers[i] - expected)
        })
    }

    /// The lens with its numbers moved.
    pub(super) fn moved(&self, by: &[f64]) -> Self {
        Self {
            log_focal: self.log_focal + by[0],
            k1: self.k1 + by[1],
            k2: self.k2 + by[2],
            shift: self.shift + DVec2::new(by[3], by[4]),
            ..*self
        }
    }
}

/// Numbers of a lens: focal length, distortion, principal point.
pub(super) const NUMBERS: usize = 5;
