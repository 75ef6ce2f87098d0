//! Pinhole cameras.

use crate::Pose;
use crate::fov::field_of_view;
use glam::{DVec2, DVec3};

/// Pinhole intrinsics in pixels; pixel centers lie at half-integers.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
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
    /// The intrinsics after cropping: `left` and `top` pixels were removed at those borders.
    pub fn cropped(&self, left: f64, top: f64) -> Self {
        Self { cx: self.cx - left, cy: self.cy - top, ..*self }
    }

    /// The intrinsics after resizing by the factors `sx` and `sy` (new size over old).
    pub fn resized(&self, sx: f64, sy: f64) -> Self {
        Self { fx: self.fx * sx, fy: self.fy * sy, cx: self.cx * sx, cy: self.cy * sy }
    }

    /// The fields of view (vertical, horizontal) of an image of this size: full angles in radians, `2 atan(size / 2f)`.
    pub fn fov(&self, width: usize, height: usize) -> [f64; 2] {
        let fov = |focal, size: usize| field_of_view(focal, size as f64, f64::atan);
        [fov(self.fy, height), fov(self.fx, width)]
    }

    /// Projects a point in camera coordinates to pixels: `(fx x / z + cx, fy y / z + cy)`, for any sign of z.
    pub fn project(&self, p: DVec3) -> DVec2 {
        DVec2::new(self.fx * p.x / p.z + self.cx, self.fy * p.y / p.z + self.cy)
    }

    /// The point in camera coordinates at `pixel` with depth `z` along the optical axis: `K^-1 (u, v, 1) z`.
    pub fn unproject(&self, pixel: DVec2, z: f64) -> DVec3 {
        DVec3::new((pixel.x - self.cx) / self.fx * z, (pixel.y - self.cy) / self.fy * z, z)
    }
}

/// A pinhole camera: pose, intrinsics and image size.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Camera {
    /// World-to-camera pose.
    pub pose: Pose,
    /// Intrinsics for an image of `width` x `height`.
    pub intrinsics: Intrinsics,
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
}

impl Camera {
    /// The camera of the photo shrunk to a longest side, pixels; of one that is no larger, the same.
    ///
    /// ```
    /// use weaver_geometry::{Camera, Intrinsics, Pose};
    /// let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 80.0, cy: 60.0 };
    /// let camera = Camera { pose: Pose::IDENTITY, intrinsics, width: 160, height: 120 };
    /// let small = camera.shrunk(40);
    /// assert_eq!((small.width, small.height, small.intrinsics.fx), (40, 30, 25.0));
    /// assert_eq!(camera.shrunk(640), camera);
    /// ```
    #[must_use]
    pub fn shrunk(&self, long_side: usize) -> Self {
        let longest = self.width.max(self.height);
        if longest <= long_side {
            return *self;
        }
        let side = |length: usize| ((length * long_side) as f64 / longest as f64).round().max(1.0) as usize;
        let (width, height) = (side(self.width), side(self.height));
        let (sx, sy) = (width as f64 / self.width as f64, height as f64 / self.height as f64);
        Self { intrinsics: self.intrinsics.resized(sx, sy), width, height, ..*self }
    }

    /// The camera that takes the mirror image of this one's photo, if the world is mirrored at its plane x = 0.
    ///
    /// ```
    /// use weaver_geometry::glam::{DMat3, DVec3};
    /// use weaver_geometry::{Camera, Intrinsics, Pose};
    /// let intrinsics = Intrinsics { fx: 9.0, fy: 9.0, cx: 3.0, cy: 4.0 };
    /// let pose = Pose::new(DMat3::from_rotation_y(0.3), DVec3::new(0.1, 0.2, 2.0));
    /// let camera = Camera { pose, intrinsics, width: 8, height: 8 };
    /// let seen = |camera: &Camera, point: DVec3| camera.intrinsics.project(camera.pose.apply(point));
    /// let (a, b) = (seen(&camera, DVec3::new(0.5, 0.1, 1.0)), seen(&camera.mirrored(), DVec3::new(-0.5, 0.1, 1.0)));
    /// assert!((a.x + b.x - 8.0).abs() < 1e-12 && (a.y - b.y).abs() < 1e-12);
    /// ```
    #[must_use]
    pub fn mirrored(&self) -> Self {
        let intrinsics = Intrinsics { cx: self.width as f64 - self.intrinsics.cx, ..self.intrinsics };
        Self { pose: self.pose.mirrored(), intrinsics, ..*self }
    }

    /// The world point at `pixel` with depth `z` along the optical axis: `R^T (K^-1 (u, v, 1) z - t)`.
    pub fn unproject(&self, pixel: DVec2, z: f64) -> DVec3 {
        self.pose.rotation.transpose() * (self.intrinsics.unproject(pixel, z) - self.pose.translation)
    }
}
