//! Quality by surfaces: meshes of the depth that scenes are drawn with.

use crate::{CompressError, Pictures};
use weaver_geometry::Camera;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_mesh::{DistanceField, Mesh, RangeView, compare};
use weaver_scene::{CameraRows, Gaussians};
use weaver_splat::{CpuRasterizer, Images, RasterSettings, Rasterizer};
use weaver_surfel::{Lens, SurfelCamera};

/// The least distance of a camera from the point that all look at, in units of which surfaces are compared: with it, distances beyond a twentieth
/// of it count as such.
const DISTANCE: f64 = 10.0;
/// Cells between a camera and that point, and cells of the truncation.
const CELLS: f64 = 96.0;
const TRUNCATION: f64 = 5.0;
/// Ranges beyond so many of these distances are background.
const FAR: f64 = 2.0;
/// Points on a cell's area of a surface to which distances are.
const PER_CELL: f64 = 32.0;
/// Alpha below which nothing is there.
const OPAQUE: f32 = 0.5;

/// The surface of a scene: depth as its cameras see it, averaged as truncated signed distances, and its zero level by surface nets.
#[derive(Debug)]
pub struct Surface {
    cameras: Vec<Camera>,
    background: [f32; 3],
    settings: RasterSettings,
    /// World units of [`DISTANCE`].
    distance: f64,
    points: Points,
}

/// A surface as points: one in each cell, from which distances are, and many, to which they are. Surfaces that hardly differ are thus
/// hardly apart.
#[derive(Debug, Default)]
struct Points {
    vertices: Vec<[f32; 3]>,
    samples: Vec<[f32; 3]>,
}

impl Surface {
    /// The surface that others are compared with.
    ///
    /// # Errors
    /// Without cameras, with cameras that look at no common point, or where the scene cannot be drawn.
    pub fn new(gaussians: &Gaussians, pictures: &Pictures<'_>) -> Result<Self, CompressError> {
        let Pictures { cameras, background, settings } = *pictures;
        if cameras.is_empty() {
            return Err(CompressError::NoCameras);
        }
        let focus = focus(cameras);
        let distance = cameras.iter().map(|c| c.pose.center().distance(focus)).fold(f64::INFINITY, f64::min);
        if !(distance.is_finite() && distance > 0.0) {
            let expected = "a common point before them".into();
            return Err(CompressError::Stream {
                place: "cameras".into(),
                expected,
                found: format!("distance {distance}"),
            });
        }
        let mut surface = Self { cameras: cameras.to_vec(), background, settings, distance, points: Points::default() };
        surface.points = surface.points(gaussians)?;
        Ok(surface)
    }

    /// Chamfer distance of a scene's surface, the mean of both mean distances, each distance at most a twentieth of the cameras' or left out, in
    /// thousandths of the least distance of a camera from the point that all look at.
    ///
    /// # Errors
    /// Where the scene cannot be drawn.
    pub fn chamfer(&self, gaussians: &Gaussians) -> Result<f64, CompressError> {
        let (own, others) = (self.points(gaussians)?, &self.points);
        let near = DISTANCE / CELLS;
        let there = compare(&own.vertices, &others.samples, near).accuracy;
        let back = compare(&own.samples, &others.vertices, near).completeness;
        Ok(1000.0 / DISTANCE * (there + back) / 2.0)
    }

    /// Points of the surface of a scene, in units in which the cameras' distance is [`DISTANCE`].
    fn points(&self, gaussians: &Gaussians) -> Result<Points, CompressError> {
        let mesh = self.mesh(gaussians)?;
        let (scale, cell) = (DISTANCE / self.distance, DISTANCE / CELLS);
        let vertices: Vec<[f32; 3]> =
            mesh.vertices.into_iter().map(|vertex| vertex.map(|x| (f64::from(x) * scale) as f32)).collect();
        let mesh = Mesh { vertices, triangles: mesh.triangles };
        let mut samples = mesh.sample(PER_CELL / (cell * cell), 0);
        samples.extend(&mesh.vertices);
        Ok(Points { vertices: mesh.vertices, samples })
    }

    fn mesh(&self, gaussians: &Gaussians) -> Result<Mesh, CompressError> {
        let activated = gaussians.to_activated();
        let mut session = CpuRasterizer.session();
        let mut drawn = Vec::with_capacity(self.cameras.len());
        for camera in &self.cameras {
            let pixels = camera.width * camera.height;
            let (mut image, mut alpha, mut depth) = (vec![0.0; 3 * pixels], vec![0.0; pixels], vec![0.0; pixels]);
            let rows = CameraRows::new(&[*camera]);
            let images = Images { image: &mut image, alpha: &mut alpha, depth: Some(&mut depth), features: None };
            session.forward(&activated.as_slices(), &rows.as_slices(&self.background), &self.settings, images)?;
            let lens =
                SurfelCamera { lens: Lens::Pinhole(camera.intrinsics), width: camera.width, height: camera.height };
            let range = |pixel: usize| {
                if alpha[pixel] < OPAQUE {
                    return 0.0;
                }
                let ray = lens.pixel_ray(pixel % camera.width, pixel / camera.width);
                let range = f64::from(depth[pixel] / alpha[pixel]) / ray.z;
                if range < FAR * self.distance { range as f32 } else { 0.0 }
            };
            drawn.push((lens, camera.pose, (0..pixels).map(range).collect::<Vec<f32>>()));
        }
        let views: Vec<RangeView<'_>> =
            drawn.iter().map(|(camera, pose, range)| RangeView { camera, pose: *pose, range, normal: &[] }).collect();
        let voxel = self.distance / CELLS;
        Ok(DistanceField::new(&views, voxel, TRUNCATION * voxel)?.mesh())
    }
}

/// The point that is nearest to all optical axes, by least squares.
fn focus(cameras: &[Camera]) -> DVec3 {
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for camera in cameras {
        let axis = camera.pose.rotation.transpose() * DVec3::Z;
        let across = DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        matrix += across;
        right += across * camera.pose.center();
    }
    if matrix.determinant().abs() > 1e-9 { matrix.inverse() * right } else { DVec3::NAN }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_scene::orbit;

    #[test]
    fn an_orbit_looks_at_its_middle() {
        let gaussians = Gaussians {
            means: vec![[1.0, 2.0, 3.0], [1.5, 2.0, 3.0], [1.0, 2.5, 3.5]],
            log_scales: vec![[-2.0; 3]; 3],
            ..Gaussians::default()
        };
        let cameras = orbit(&gaussians, 7, [32, 32]).unwrap();
        let middle = weaver_scene::middle(&gaussians).unwrap();
        assert!(focus(&cameras).distance(middle) < 1e-6);
    }
}
