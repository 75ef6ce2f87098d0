//! Given cameras in training units, and where their photos show points.

use crate::Error;
use crate::depth_to_points::SeenPoint;
use crate::predictor::{CameraSource, spread_ratio};
use weaver_data::SparsePoints;
use weaver_geometry::Camera;

/// Given cameras as a network takes them.
#[derive(Clone, Debug)]
pub struct GivenCameras {
    /// The cameras in training units.
    pub cameras: Vec<Camera>,
    /// Factor on their own units.
    pub scaled_by: Option<f64>,
    /// For each view the points that it shows, in training units; no lists where cameras came without points.
    pub seen: Vec<Vec<SeenPoint>>,
}

impl GivenCameras {
    /// Checks that a source has as many cameras as there are photos, and lists of points that exist for each.
    ///
    /// # Errors
    /// [`Error::Input`] with the expected and the found value.
    pub fn check(source: CameraSource<'_>, views: usize) -> Result<(), Error> {
        let wrong = |what: &str, expected: usize, found: usize| {
            Err(Error::Input(format!("{what}: expected {expected}, as many as photos, found {found}")))
        };
        match source.given() {
            Some(cameras) if cameras.len() != views => return wrong("given cameras", views, cameras.len()),
            _ => {}
        }
        if let CameraSource::GivenWithPoints { points, .. } = source {
            if points.visible.len() != views {
                return wrong("lists of visible points", views, points.visible.len());
            }
            let count = points.positions.len();
            if let Some(index) = points.visible.iter().flatten().find(|index| **index as usize >= count) {
                return Err(Error::Input(format!("visible points: expected indices below {count}, found {index}")));
            }
        }
        Ok(())
    }

    /// The cameras of a source, beside those that the network predicts; `None` if it is to use its own.
    pub fn of(source: CameraSource<'_>, predicted: &[Camera]) -> Option<Self> {
        let cameras = source.given()?;
        let points = if let CameraSource::GivenWithPoints { points, .. } = source { Some(points) } else { None };
        let scaled_by = match source {
            CameraSource::Given(_) => None,
            _ => {
                let measured = points.and_then(|points| scale_to_points(cameras, points));
                Some(measured.unwrap_or_else(|| spread_ratio(predicted, cameras)))
            }
        };
        let scale = scaled_by.unwrap_or(1.0);
        let scaled = |camera: &Camera| match scaled_by {
            Some(factor) => Camera { pose: camera.pose.scaled(factor), ..*camera },
            None => *camera,
        };
        let cameras: Vec<Camera> = cameras.iter().map(scaled).collect();
        let seen = points.map_or(Vec::new(), |points| {
            cameras.iter().zip(&points.visible).map(|(camera, visible)| seen(camera, points, visible, scale)).collect()
        });
        Some(Self { cameras, scaled_by, seen })
    }
}

/// The factor that makes the mean distance from camera 0 to the points that the photos show 1; `None` where they show
/// none.
fn scale_to_points(cameras: &[Camera], points: &SparsePoints) -> Option<f64> {
    let distance = points.mean_distance(cameras.first()?.pose.center())?;
    (distance > 0.0 && distance.is_finite()).then(|| 1.0 / distance)
}

/// Pixels of the points in a camera in training units; a unit of the points is `scale` training units.
fn seen(camera: &Camera, points: &SparsePoints, visible: &[u32], scale: f64) -> Vec<SeenPoint> {
    let point = |index: &u32| {
        let local = camera.pose.apply(points.positions[*index as usize] * scale);
        SeenPoint { pixel: camera.intrinsics.project(local).to_array(), depth: local.z }
    };
    visible.iter().map(point).collect()
}
