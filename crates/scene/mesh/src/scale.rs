//! Sizes by which a scene is meshed.

use weaver_geometry::trajectory::focus;
use weaver_geometry::{Camera, Pose};

/// The most cells between a camera and the point that all cameras look at.
const CELLS: f64 = 256.0;
/// Distances of the nearest camera from that point, beyond which everything is background.
const FAR: f64 = 2.0;

/// Range and resolution of the mesh of a scene, world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneScale {
    /// Distance from a camera beyond which everything is background.
    pub far: f64,
    /// Side of a cell.
    pub voxel: f64,
}

impl SceneScale {
    /// The scale that cameras suggest, with `far` and `voxel` in place of their suggestions: background begins at twice
    /// the least distance of a camera from the point that all look at, a cell is a 256th of that distance and at least
    /// a pixel. `None` of cameras that look at no common point before them, unless `far` is given.
    pub fn of(cameras: &[Camera], far: Option<f64>, voxel: Option<f64>) -> Option<Self> {
        let scale = distance(cameras).or(far.map(|far| far / FAR))?;
        let pixels = cameras.iter().map(|camera| camera.intrinsics.fx).fold(0.0, f64::max);
        Some(Self { far: far.unwrap_or(FAR * scale), voxel: voxel.unwrap_or(scale / pixels.min(CELLS)) })
    }
}

/// The least distance of a camera from the point that all look at, if that is before them.
fn distance(cameras: &[Camera]) -> Option<f64> {
    let poses: Vec<Pose> = cameras.iter().map(|camera| camera.pose).collect();
    let focus = focus(&poses)?;
    let before = poses.iter().filter(|pose| pose.apply(focus).z > 0.0).count();
    let nearest = poses.iter().map(|pose| pose.center().distance(focus)).fold(f64::INFINITY, f64::min);
    (2 * before > poses.len() && nearest > 0.0).then_some(nearest)
}
