//! Points and pixels of a camera with a lens.

use super::{Lens, Projection};
use crate::Camera;
use glam::{DVec2, DVec3};

/// A camera with a lens, ready to project. Depth is z for a pinhole, and the distance for a lens.
///
/// ```
/// use weaver_geometry::glam::{DVec2, DVec3};
/// use weaver_geometry::lens::{self, Lens, LensCamera};
/// use weaver_geometry::{Camera, Pose};
/// let intrinsics = lens::fisheye(4.0, 100, 100);
/// let camera = Camera { pose: Pose::IDENTITY, intrinsics, width: 100, height: 100 };
/// let fisheye = LensCamera::new(camera, Some(Lens::EQUIDISTANT));
/// let (pixel, distance) = fisheye.see(DVec3::new(0.0, 2.0, 0.0)).unwrap();
/// assert!((pixel - DVec2::new(50.0, 50.0 + 25.0 * std::f64::consts::FRAC_PI_2)).length() < 1e-9 && distance == 2.0);
/// assert!((fisheye.point(pixel, distance).unwrap() - DVec3::new(0.0, 2.0, 0.0)).length() < 1e-9);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct LensCamera {
    /// Its pose, intrinsics and size.
    pub camera: Camera,
    projection: Option<Projection>,
}

impl LensCamera {
    /// A camera with a lens, or a pinhole.
    pub fn new(camera: Camera, lens: Option<Lens>) -> Self {
        Self { camera, projection: lens.map(Lens::projection) }
    }

    /// The pixel that shows a point of camera coordinates, inside of the image or not, and the point's depth; `None`
    /// where the lens sees nothing.
    pub fn see(&self, local: DVec3) -> Option<(DVec2, f64)> {
        let k = &self.camera.intrinsics;
        match &self.projection {
            None => (local.z > 0.0).then(|| (k.project(local), local.z)),
            Some(projection) => {
                let at = projection.project(local)?;
                Some((DVec2::new(k.fx * at.x + k.cx, k.fy * at.y + k.cy), local.length()))
            }
        }
    }

    /// The point of camera coordinates at a pixel and a depth; `None` where the lens sees nothing.
    pub fn point(&self, pixel: DVec2, depth: f64) -> Option<DVec3> {
        match &self.projection {
            None => Some(self.camera.intrinsics.unproject(pixel, depth)),
            Some(projection) => {
                let at = self.camera.intrinsics.unproject(pixel, 1.0).truncate();
                Some(projection.ray(at)? * depth)
            }
        }
    }

    /// The gradients of the pixel's x and y by the point of camera coordinates; `None` where the lens sees nothing.
    pub fn gradients(&self, p: DVec3) -> Option<[DVec3; 2]> {
        let k = &self.camera.intrinsics;
        match &self.projection {
            None => {
                Some([DVec3::new(k.fx, 0.0, -k.fx * p.x / p.z) / p.z, DVec3::new(0.0, k.fy, -k.fy * p.y / p.z) / p.z])
            }
            Some(projection) => projection.jacobian(p).map(|[x, y]| [k.fx * x, k.fy * y]),
        }
    }
}
