//! A photo's view of a mesh: visible points, and how well they are seen.

use super::{PhotoView, raster};
use crate::Mesh;
use rayon::prelude::*;
use weaver_geometry::Camera;
use weaver_geometry::glam::{DVec2, DVec3};

/// Longest side of a depth image, pixels.
const LONG_SIDE: usize = 640;
/// Least cosine of the angle between a normal and the way to the camera.
const FACES: f64 = 0.2;
/// Pixels by which a point may lie behind the surface, along a surface as steep as its own.
const BEHIND: f64 = 2.0;
/// Bands of rows that are drawn side by side.
const BANDS: usize = 16;

/// A photo with the depth of a mesh.
pub struct Sight<'a> {
    pub photo: PhotoView<'a>,
    small: Camera,
    /// Least depth `[H, W]` of the small camera, of a pixel and the eight around it.
    depth: Vec<f32>,
}

impl<'a> Sight<'a> {
    pub fn new(mesh: &Mesh, photo: &PhotoView<'a>) -> Self {
        let small = photo.camera.shrunk(LONG_SIDE);
        let depth = least_around(&drawn(mesh, &small), small.width);
        Self { photo: *photo, small, depth }
    }

    /// Pixels of the photo for one of the depth image.
    pub fn shrink(&self) -> f64 {
        self.photo.camera.width as f64 / self.small.width as f64
    }

    /// The place of a point on the photo.
    pub fn pixel(&self, point: DVec3) -> DVec2 {
        self.photo.camera.intrinsics.project(self.photo.camera.pose.apply(point))
    }

    /// Quality at which a point with this normal is seen: the cosine of its angle over its squared depth in focal
    /// lengths; none where the photo does not have it, or does not count there.
    pub fn quality(&self, point: DVec3, normal: DVec3) -> Option<f64> {
        let camera = &self.photo.camera;
        let p = camera.pose.apply(point);
        let at = self.small.intrinsics.project(p);
        let (width, height) = (self.small.width as f64, self.small.height as f64);
        let inside = at.x >= 1.0 && at.y >= 1.0 && at.x < width - 1.0 && at.y < height - 1.0;
        let facing = -(camera.pose.rotation * normal.normalize_or_zero()).dot(p.normalize_or_zero());
        if p.z <= 0.0 || !inside || facing < FACES {
            return None;
        }
        let step = p.z / self.small.intrinsics.fx.min(self.small.intrinsics.fy);
        let least = f64::from(self.depth[at.y as usize * self.small.width + at.x as usize]);
        let hidden = p.z > least + BEHIND * step * (1.0 + 1.0 / facing);
        let counts = || {
            let at = camera.intrinsics.project(p);
            let pixel = (at.y as usize).min(camera.height - 1) * camera.width + (at.x as usize).min(camera.width - 1);
            self.photo.mask.is_none_or(|mask| mask[pixel])
        };
        (!hidden && counts()).then(|| facing * (camera.intrinsics.fx / p.z).powi(2))
    }
}

/// The depth of a mesh at the centers of a camera's pixels, infinite where nothing is. Triangles that reach behind the
/// camera are left out.
fn drawn(mesh: &Mesh, camera: &Camera) -> Vec<f32> {
    let points: Vec<DVec3> = mesh
        .vertices
        .par_iter()
        .map(|v| {
            let p = camera.pose.apply(DVec3::from_array(v.map(f64::from)));
            camera.intrinsics.project(p).extend(p.z)
        })
        .collect();
    let mut depth = vec![f32::INFINITY; camera.width * camera.height];
    let rows = camera.height.div_ceil(BANDS);
    depth.par_chunks_mut(rows * camera.width).enumerate().for_each(|(band, depth)| {
        let (top, height) = ((band * rows) as f64, depth.len() / camera.width);
        for triangle in &mesh.triangles {
            let corners = triangle.map(|v| points[v as usize]);
            let at = corners.map(|p| DVec2::new(p.x, p.y - top));
            let (low, high) = (at[0].y.min(at[1].y).min(at[2].y), at[0].y.max(at[1].y).max(at[2].y));
            if high < 0.0 || low > height as f64 || !corners.iter().all(|p| p.z > 0.0) {
                continue;
            }
            // Inverse depth is linear on the image.
            let inverse = corners.map(|p| 1.0 / p.z);
            raster::inside(at, [camera.width, height], |x, y, parts| {
                let z = 1.0 / (parts[0] * inverse[0] + parts[1] * inverse[1] + parts[2] * inverse[2]);
                let nearest = &mut depth[y * camera.width + x];
                *nearest = nearest.min(z as f32);
            });
        }
    });
    depth
}

/// The least of each pixel and the eight around it.
fn least_around(depth: &[f32], width: usize) -> Vec<f32> {
    let height = depth.len() / width.max(1);
    let least = |i: usize| {
        let (x, y) = (i % width, i / width);
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let row = |y: usize| depth[y * width + x.saturating_sub(1)..y * width + (x + 2).min(width)].iter();
        rows.flat_map(row).copied().fold(f32::INFINITY, f32::min)
    };
    (0..depth.len()).into_par_iter().map(least).collect()
}
