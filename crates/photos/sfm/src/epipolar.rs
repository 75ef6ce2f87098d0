//! Epipolar geometry: the places in one camera where a point of another may be.

use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose, so3};

/// The fundamental matrix of two cameras, and the largest distance of a match from its line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Epipolar {
    fundamental: DMat3,
    farthest: f64,
}

impl Epipolar {
    /// Of two cameras; `farthest` in pixels of the second.
    pub fn new(first: &Camera, second: &Camera, farthest: f64) -> Self {
        let across: Pose = second.pose.relative_to(&first.pose);
        let essential = so3::hat(across.translation.normalize_or_zero()) * across.rotation;
        let fundamental = inverse(&second.intrinsics).transpose() * essential * inverse(&first.intrinsics);
        Self { fundamental, farthest }
    }

    /// The line in the second photo on which the point at a pixel of the first lies: `a u + b v + c` is the distance of
    /// (u, v) in pixels. All zero where the cameras stand in the same place.
    pub fn line(&self, pixel: DVec2) -> DVec3 {
        let line = self.fundamental * pixel.extend(1.0);
        let length = DVec2::new(line.x, line.y).length();
        if length > 0.0 { line / length } else { DVec3::ZERO }
    }

    /// True if two pixels may show the same point.
    pub fn allows(&self, first: DVec2, second: DVec2) -> bool {
        self.line(first).dot(second.extend(1.0)).abs() <= self.farthest
    }

    /// Largest distance of a match from its line, pixels.
    pub fn farthest(&self) -> f64 {
        self.farthest
    }
}

/// The inverse of the matrix of intrinsics.
fn inverse(k: &Intrinsics) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(1.0 / k.fx, 0.0, 0.0),
        DVec3::new(0.0, 1.0 / k.fy, 0.0),
        DVec3::new(-k.cx / k.fx, -k.cy / k.fy, 1.0),
    )
}
