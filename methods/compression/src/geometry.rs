//! Quality by surfaces: meshes of the drawn depth of scenes.

use crate::CompressionError;
use weaver_compress::{CompressError, Pictures};
use weaver_geometry::trajectory::focus;
use weaver_geometry::{Camera, Pose};
use weaver_mesh::{DistanceField, DrawnScene, FAR, Mesh, compare};
use weaver_scene::Gaussians;
use weaver_splat::RasterSettings;

/// The least distance of a camera from the common focus, in the units of surface distances, which count as a twentieth
/// of it at most.
const DISTANCE: f64 = 10.0;
/// Cells between a camera and the focus, and cells of the truncation.
const CELLS: f64 = 96.0;
const TRUNCATION: f64 = 5.0;
/// Range of the background, in distances of the cameras from the focus.
const BACKGROUND: f64 = 2.0;
/// Sampled points on a cell's area of a surface.
const PER_CELL: f64 = 32.0;

/// The surface of a scene: depth from its cameras, averaged as truncated signed distances, and its zero level by
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

/// A surface as points: one in each cell as starts of distances, and many as their ends.
#[derive(Debug, Default)]
struct Points {
    vertices: Vec<[f32; 3]>,
    samples: Vec<[f32; 3]>,
}

impl Surface {
    /// The reference surface.
    ///
    /// # Errors
    /// Without cameras, with cameras without a common focus, or when the scene cannot be drawn.
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
    /// cameras' or left out, in thousandths of the least distance of a camera from the common focus.
    ///
    /// # Errors
    /// When the scene cannot be drawn.
    pub fn chamfer(&self, gaussians: &Gaussians) -> Result<f64, CompressionError> {
        let (own, others) = (self.points(gaussians)?, &self.points);
        let near = DISTANCE / CELLS;
        // A surface without points, or without near ones, has the largest distance.
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
