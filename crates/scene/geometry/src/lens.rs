//! Lenses: projections of directions to the plane of an image and back, with their derivatives, also beyond 90 degrees
//! from the axis.

pub(crate) mod angles;
mod camera;

use crate::{Camera, Distortion, Intrinsics};
use angles::Angles;
pub use camera::LensCamera;
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// A lens, without the size of its image: pixel = (fx x + cx, fy y + cy) for the place (x, y) at which it sees a
/// direction.
///
/// ```
/// use weaver_geometry::glam::{DVec2, DVec3};
/// use weaver_geometry::{Distortion, lens::Lens};
/// let fisheye = Lens::Distorted(Distortion::Fisheye { k: [0.0; 4] }).projection();
/// let behind = DVec3::new(1.0, 0.0, -1.0);
/// assert!((fisheye.project(behind).unwrap() - DVec2::new(135_f64.to_radians(), 0.0)).length() < 1e-12);
/// let sphere = Lens::Equirectangular.projection();
/// assert!((sphere.ray(DVec2::new(0.0, 0.5)).unwrap() - DVec3::new(0.0, 0.5_f64.sin(), 0.5_f64.cos())).length() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Lens {
    /// A distortion of a pinhole's rays. Fish eyes and the field-of-view model see beyond 90 degrees from the axis.
    Distorted(Distortion),
    /// Longitude and latitude, radians: (atan2(x, z), atan2(y, hypot(x, z))), the latitude downward. A whole sphere is
    /// an image of [`equirectangular`] intrinsics.
    Equirectangular,
}

impl Lens {
    /// A pinhole.
    pub const PINHOLE: Self = Self::Distorted(Distortion::Radial { k: [0.0; 6], p: [0.0; 2] });
    /// The equidistant fisheye: a direction goes to its angle from the axis.
    pub const EQUIDISTANT: Self = Self::Distorted(Distortion::Fisheye { k: [0.0; 4] });

    /// The lens of a photo; a pinhole if there is no distortion.
    pub fn of(distortion: Option<Distortion>) -> Self {
        distortion.map_or(Self::PINHOLE, Self::Distorted)
    }

    /// The lens, ready to project.
    pub fn projection(self) -> Projection {
        match self {
            Self::Equirectangular => Projection { lens: self, angles: None, last: PI },
            Self::Distorted(distortion) => {
                let angles = distortion.angles();
                let last = angles.map_or_else(|| distortion.last_angle(), |angles| angles.last_angle());
                Projection { lens: self, angles, last }
            }
        }
    }

    /// The field of view of a camera with this lens, a full angle in radians: the larger one of that across and that
    /// down its image, through the principal point.
    ///
    /// ```
    /// use weaver_geometry::lens::{self, Lens};
    /// use weaver_geometry::{Camera, Pose};
    /// let camera = Camera { pose: Pose::IDENTITY, intrinsics: lens::fisheye(2.0, 80, 60), width: 80, height: 60 };
    /// assert!((Lens::EQUIDISTANT.field_of_view(&camera) - 2.0 * 80.0 / 60.0).abs() < 1e-9);
    /// ```
    pub fn field_of_view(self, camera: &Camera) -> f64 {
        let Intrinsics { fx, fy, cx, cy } = camera.intrinsics;
        if self == Self::Equirectangular {
            return (camera.width as f64 / fx).max(camera.height as f64 / fy).min(TAU);
        }
        let projection = self.projection();
        // What lies beyond the lens's circle is not seen.
        let angle = |at: DVec2| projection.ray(at).map_or(projection.last, |ray| ray.z.clamp(-1.0, 1.0).acos());
        let across = angle(DVec2::new(-cx / fx, 0.0)) + angle(DVec2::new((camera.width as f64 - cx) / fx, 0.0));
        let down = angle(DVec2::new(0.0, -cy / fy)) + angle(DVec2::new(0.0, (camera.height as f64 - cy) / fy));
        across.max(down)
    }
}

/// The intrinsics of an equirectangular image of the whole sphere: W / 2 pi and H / pi pixels for each radian.
pub fn equirectangular(width: usize, height: usize) -> Intrinsics {
    let (w, h) = (width as f64, height as f64);
    Intrinsics { fx: w / TAU, fy: h / PI, cx: 0.5 * w, cy: 0.5 * h }
}

/// The intrinsics of an equidistant fisheye whose circle of `field` radians, a full angle, touches the nearer sides.
pub fn fisheye(field: f64, width: usize, height: usize) -> Intrinsics {
    let f = width.min(height) as f64 / field;
    Intrinsics { fx: f, fy: f, cx: 0.5 * width as f64, cy: 0.5 * height as f64 }
}

/// A [`Lens`], ready to project: the limit of its domain is found.
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    lens: Lens,
    angles: Option<Angles>,
    last: f64,
}

impl Projection {
    /// The largest angle to the axis, radians, up to which the distance from the axis grows with the angle. The lens
    /// sees nothing beyond: coefficients that were fitted to a photo say nothing there.
    pub fn last_angle(&self) -> f64 {
        self.last
    }

    /// True if the lens sees a direction of any length.
    pub fn sees(&self, direction: DVec3) -> bool {
        let angle = direction.truncate().length().atan2(direction.z);
        // Also false for NaN.
        angle <= self.last && direction.length_squared() > 0.0
    }

    /// The place at which the lens sees a direction of any length; `None` if it does not see it.
    pub fn project(&self, direction: DVec3) -> Option<DVec2> {
        if !self.sees(direction) {
            return None;
        }
        let DVec3 { x, y, z } = direction;
        Some(match (self.lens, &self.angles) {
            (Lens::Equirectangular, _) => DVec2::new(x.atan2(z), y.atan2(x.hypot(z))),
            (_, Some(angles)) => angles.project(direction),
            (Lens::Distorted(distortion), None) => distortion.distort(DVec2::new(x, y) / z),
        })
    }

    /// The derivative of [`project`](Self::project) with respect to the direction: the gradients of x and of y; not
    /// finite at the poles of a sphere. `None` if the lens does not see the direction.
    pub fn jacobian(&self, direction: DVec3) -> Option<[DVec3; 2]> {
        if !self.sees(direction) {
            return None;
        }
        let DVec3 { x, y, z } = direction;
        Some(match (self.lens, &self.angles) {
            (Lens::Equirectangular, _) => {
                let flat = x * x + z * z;
                let (across, whole) = (flat.sqrt(), direction.length_squared());
                let along = -y / (across * whole);
                [DVec3::new(z, 0.0, -x) / flat, DVec3::new(x * along, across / whole, z * along)]
            }
            (_, Some(angles)) => angles.jacobian(direction),
            (Lens::Distorted(distortion), None) => {
                let at = DVec2::new(x, y) / z;
                let rows = distortion.jacobian(at).transpose();
                [rows.x_axis, rows.y_axis].map(|row| row.extend(-row.dot(at)) / z)
            }
        })
    }

    /// The direction of length 1 that is seen at a place; `None` where nothing is, as beyond the circle of a fisheye.
    pub fn ray(&self, at: DVec2) -> Option<DVec3> {
        match (self.lens, &self.angles) {
            (Lens::Equirectangular, _) => {
                let ((sin_x, cos_x), (sin_y, cos_y)) = (at.x.sin_cos(), at.y.sin_cos());
                // Also false for NaN.
                let seen = at.x.abs() <= PI && at.y.abs() <= FRAC_PI_2;
                seen.then(|| DVec3::new(cos_y * sin_x, sin_y, cos_y * cos_x))
            }
            (_, Some(angles)) => angles.ray(at, self.last),
            (Lens::Distorted(distortion), None) => {
                Some(distortion.undistort_within(at, self.last)?.extend(1.0).normalize())
            }
        }
    }
}
