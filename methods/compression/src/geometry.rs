//! Quality by surfaces: meshes of the depth that scenes are drawn with.

use crate::CompressionError;
use weaver_compress::{CompressError, Pictures};
use weaver_geometry::trajectory::focus;
use weaver_geometry::{Camera, Pose};
use weaver_mesh::{DistanceField, DrawnScene, FAR, Mesh, compare};
use weaver_scene::Gaussians;
use weaver_splat::RasterSettings;

/// The least distance of a camera from the common focus, in units in which surfaces are compared: distances beyond a
/// twentieth of it count as a twentieth.
const DISTANCE: f64 = 10.0;
/// Cells between a camera and that point, and cells of the truncation.
const CELLS: f64 = 96.0;
const TRUNCATION: f64 = 5.0;
/// Ranges beyond so many of these distances are background.
const BACKGROUND: f64 = 2.0;
/// Points on a cell's area of a surface to which distances are.
const PER_CELL: f64 = 32.0;

/// The surface of a scene: depth as its cameras see it, averaged as truncated signed distances, and its zero level by
/// surface nets.
#[derive(Debug)]
pub struct Surface {
    cameras: Vec<Camera>,
    background: [f32; 3],
    settings: RasterSettings,
    /// World units of [`DISTANCE`].
    distance: f64,
    points: Points,
}

/// A surface as points: one in each cell, to measure distances from, and many, to measure distances to.
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
    pub fn new(gaussians: &Gaussians, pictures: &Pictures<'_>) -> Result<Self, CompressionError> {
        let Pictures { cameras, background, settings } = *pictures;
        if cameras.is_empty() {
            return Err(CompressError::NoCameras.into());
        }
        let poses: Vec<Pose> = cameras.iter().map(|camera| camera.pose).collect();
        let nearest = |focus| poses.iter().map(|pose| pose.center().distance(focus)).fold(f64::INFINITY, f64::min);
        let distance = focus(&poses).map_or(0.0, nearest);
        if !(distance.is_finite() && distance > 0.0) {
            let (place, expected) = ("cameras".into(), "a common point before them".into());
            return Err(CompressionError::Stream { place, expected, found: format!("distance {distance}") });
        }
        let mut surface = Self { cameras: cameras.to_vec(), background, settings, distance, points: Points::default() };
        surface.points = surface.points(gaussians)?;
        Ok(surface)
    }

    /// Chamfer distance of a scene's surface, the mean of both mean distances, each distance at most a twentieth of the
    /// cameras' or left out, in thousandths of the least distance of a camera from the point that all look at.
    ///
    /// # Errors
    /// Where the scene cannot be drawn.
    pub fn chamfer(&self, gaussians: &Gaussians) -> Result<f64, CompressionError> {
        let (own, others) = (self.points(gaussians)?, &self.points);
        let near = DISTANCE / CELLS;
        // A surface without any points, or without near ones, is as far off as can be.
        let there = compare(&own.vertices, &others.samples, near).and_then(|errors| errors.accuracy).unwrap_or(FAR);
        let back = compare(&own.samples, &others.vertices, near).map_or(FAR, |errors| errors.completeness);
        Ok(1000.0 / DISTANCE * (there + back) / 2.0)
    }

    /// Points of the surface of a scene, in units in which the cameras' distance is [`DISTANCE`].
    fn points(&self, gaussians: &Gaussians) -> Result<Points, CompressionError> {
        let mesh = self.mesh(gaussians)?;
        let (scale, cell) = (DISTANCE / self.distance, DISTANCE / CELLS);
        let vertices: Vec<[f32; 3]> =
            mesh.vertices.into_iter().map(|vertex| vertex.map(|x| (f64::from(x) * scale) as f32)).collect();
        let mesh = Mesh { vertices, triangles: mesh.triangles };
        let mut samples = mesh.sample(PER_CELL / (cell * cell), 0);
        samples.extend(&mesh.vertices);
        Ok(Points { vertices: mesh.vertices, samples })
    }

    fn mesh(&self, gaussians: &Gaussians) -> Result<Mesh, CompressionError> {
        let mut scene = DrawnScene::new(gaussians, self.background, self.settings, BACKGROUND * self.distance);
        self.cameras.iter().try_for_each(|camera| scene.add(camera))?;
        let voxel = self.distance / CELLS;
        Ok(DistanceField::new(&scene.views(), voxel, TRUNCATION * voxel)?.mesh())
    }
}
