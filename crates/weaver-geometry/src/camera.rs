//! Pinhole cameras.

use crate::Pose;
use crate::fov::field_of_view;
use glam::{DVec2, DVec3};

/// Pinhole intrinsics in pixels; pixel centers lie at half-integers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Horizontal focal length, pixels.
    pub fx: f64,
    /// Vertical focal length, pixels.
    pub fy: f64,
    /// Principal point, x in pixels from the left border.
    pub cx: f64,
    /// Principal point, y in pixels from the top border.
    pub cy: f64,
}

impl Intrinsics {
    /// The intrinsics after the image lost `left` and `top` pixels at those borders.
    pub fn cropped(&self, left: f64, top: f64) -> Self {
        Self { cx: self.cx - left, cy: self.cy - top, ..*self }
    }

    /// The intrinsics after the image was resized by `sx` and `sy` (new size over old).
    pub fn resized(&self, sx: f64, sy: f64) -> Self {
        Self { fx: self.fx * sx, fy: self.fy * sy, cx: self.cx * sx, cy: self.cy * sy }
    }

    /// Full fields of view (vertical, horizontal) in radians, `2 atan(size / 2f)`.
    pub fn fov(&self, width: usize, height: usize) -> [f64; 2] {
        let fov = |focal, size: usize| field_of_view(focal, size as f64, f64::atan);
        [fov(self.fy, height), fov(self.fx, width)]
    }

    /// Projects a point in camera coordinates to pixels (no check of z).
    pub fn project(&self, p: DVec3) -> DVec2 {
        DVec2::new(self.fx * p.x / p.z + self.cx, self.fy * p.y / p.z + self.cy)
    }

    /// The camera-space point at `pixel` with depth `z` along the optical axis.
    pub fn unproject(&self, pixel: DVec2, z: f64) -> DVec3 {
        DVec3::new((pixel.x - self.cx) / self.fx * z, (pixel.y - self.cy) / self.fy * z, z)
    }
}

/// A pinhole camera: where it stands, how it sees, and the size of its image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// World to camera.
    pub pose: Pose,
    /// Intrinsics for an image of `width` x `height`.
    pub intrinsics: Intrinsics,
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
}

impl Camera {
    /// The world point at `pixel` with depth `z` along the optical axis: `R^T (K^-1 (u, v, 1) z - t)`.
    pub fn unproject(&self, pixel: DVec2, z: f64) -> DVec3 {
        self.pose.rotation.transpose() * (self.intrinsics.unproject(pixel, z) - self.pose.translation)
    }
}
