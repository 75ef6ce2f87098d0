//! Estimated cameras beside others of the same photos.

use crate::Error;
use std::fmt;
use std::path::{Path, PathBuf};
use weaver_data::{EstimatedPhotos, some_of};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Pose, Similarity};

/// Cameras that are more degrees than this from others are named.
const ELSEWHERE: f64 = 5.0;
/// Rounds of an alignment that leaves out cameras that are far off.
const ROUNDS: usize = 5;

/// Differences of estimated cameras from others, once moved, turned and scaled to fit best.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraComparison {
    /// Photos that have both cameras.
    pub photos: usize,
    /// Rotations, degrees: the median and the largest.
    pub rotation: [f64; 2],
    /// Centers, percent of the cameras' spread: the median and the largest.
    pub center: [f64; 2],
    /// Focal lengths, percent: the median, with its sign.
    pub focal: f64,
    /// Photos whose cameras are more than five degrees apart.
    pub elsewhere: Vec<PathBuf>,
}

impl fmt::Display for CameraComparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rotation: [turned, most_turned], center: [off, most_off], focal, elsewhere, .. } = self;
        write!(
            f,
            "rotation {turned:.3} degrees in the median, {most_turned:.2} at most; center {off:.2} % of the cameras' spread, {most_off:.1} at most; focal length {focal:+.2} %"
        )?;
        if elsewhere.is_empty() {
            return Ok(());
        }
        let names: Vec<String> = elsewhere.iter().map(|path| path.display().to_string()).collect();
        write!(f, "; more than {ELSEWHERE} degrees apart: {}", some_of(&names))
    }
}

impl CameraComparison {
    /// Compares estimated cameras with the cameras of a file.
    ///
    /// # Errors
    /// When the file cannot be read or lacks a photo; when all its cameras are in one place.
    pub fn of(found: &EstimatedPhotos, file: &Path) -> Result<Self, Error> {
        let placed = found.placed();
        let truth = weaver_data::capture::load_camera_files(file, &placed)?;
        let estimated: Vec<Camera> = found.estimate.cameras.iter().flatten().copied().collect();
        let poses = |cameras: &[Camera]| -> Vec<Pose> { cameras.iter().map(|c| c.pose).collect() };
        let (from, to) = (poses(&estimated), poses(&truth));
        let onto = aligned(&from, &to).ok_or_else(|| Error::Compared { file: file.into() })?;
        let middle = to.iter().map(Pose::center).sum::<DVec3>() / to.len() as f64;
        let spread = to.iter().map(|p| p.center().distance(middle)).sum::<f64>() / to.len() as f64;
        let moved: Vec<Pose> = from.iter().map(|p| onto.apply_to_pose(p)).collect();
        let both = || moved.iter().zip(&to);
        let turned: Vec<f64> = both().map(|(a, b)| a.angle_to(b).to_degrees()).collect();
        let elsewhere = placed.iter().zip(&turned).filter(|(_, degrees)| **degrees > ELSEWHERE);
        let elsewhere: Vec<PathBuf> = elsewhere.map(|(path, _)| path.clone()).collect();
        let off: Vec<f64> = both().map(|(a, b)| 100.0 * a.center().distance(b.center()) / spread).collect();
        let focal = |c: &Camera| c.intrinsics.fx / c.width as f64;
        let longer = estimated.iter().zip(&truth).map(|(a, b)| 100.0 * (focal(a) / focal(b) - 1.0)).collect();
        Ok(Self {
            photos: placed.len(),
            rotation: median_and_largest(turned),
            center: median_and_largest(off),
            focal: median_and_largest(longer)[0],
            elsewhere,
        })
    }
}

fn median_and_largest(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    [values[values.len() / 2], values[values.len() - 1]]
}

/// The similarity that takes cameras to others, fitted without outliers: either side may have some wrong cameras.
fn aligned(from: &[Pose], to: &[Pose]) -> Option<Similarity> {
    let mut kept: Vec<usize> = (0..from.len()).collect();
    let mut onto = None;
    for _ in 0..ROUNDS {
        let [a, b] = [from, to].map(|all| kept.iter().map(|i| all[*i]).collect::<Vec<Pose>>());
        let fitted = Similarity::fit_poses(&a, &b)?;
        let off = |i: usize| fitted.apply_to_pose(&from[i]).center().distance(to[i].center());
        let mut all: Vec<f64> = (0..from.len()).map(off).collect();
        all.sort_by(f64::total_cmp);
        let most = 5.0 * all[all.len() / 2];
        kept = (0..from.len()).filter(|i| off(*i) <= most).collect();
        onto = Some(fitted);
    }
    onto
}
