//! How wrong predicted poses are, up to the choice of frame and scale. No tape.

use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;

/// Baselines shorter than this have no direction worth comparing.
const SHORTEST_BASELINE: f64 = 1e-3;

/// Errors of views 1.. of a scene, relative to camera 0, in degrees.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseErrors {
    /// Angle between predicted and true rotation relative to camera 0.
    pub rotation: Vec<f64>,
    /// Angle between the predicted and true direction of the camera's center, as camera 0 sees it. `None` where the
    /// true baseline is shorter than 1e-3; 180 where only the predicted one is, so that poses collapsed to a point
    /// do not look good.
    pub translation: Vec<Option<f64>>,
}

impl PoseErrors {
    /// Compares poses of the same views in the same order.
    pub fn between(predicted: &[Pose], truth: &[Pose]) -> Self {
        assert_eq!(predicted.len(), truth.len(), "pose errors compare the same views");
        let mut errors = Self { rotation: Vec::new(), translation: Vec::new() };
        for (p, t) in predicted.iter().zip(truth).skip(1) {
            let (p, t) = (p.relative_to(&predicted[0]), t.relative_to(&truth[0]));
            errors.rotation.push(p.angle_to(&t).to_degrees());
            errors.translation.push(direction_error(p.center(), t.center()));
        }
        errors
    }

    /// Mean rotation error; `None` for a single view.
    pub fn mean_rotation(&self) -> Option<f64> {
        mean(self.rotation.iter().copied())
    }

    /// Mean angle of the translations that have one.
    pub fn mean_translation(&self) -> Option<f64> {
        mean(self.translation.iter().copied().flatten())
    }

    /// The error of each view that counts for the area under the curve: the larger of its two angles.
    pub fn largest(&self) -> impl Iterator<Item = f64> {
        self.rotation.iter().zip(&self.translation).map(|(r, t)| t.map_or(*r, |t| t.max(*r)))
    }
}

fn direction_error(predicted: DVec3, truth: DVec3) -> Option<f64> {
    if truth.length() < SHORTEST_BASELINE {
        return None;
    }
    if predicted.length() < SHORTEST_BASELINE {
        return Some(180.0);
    }
    Some(predicted.angle_between(truth).to_degrees())
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0usize), |(sum, count), v| (sum + v, count + 1));
    (count > 0).then(|| sum / count as f64)
}

/// The area under the recall curve up to `threshold`, in `[0, 1]`: the mean of max(0, 1 - error / threshold), which is
/// the exact integral of the share of errors below x over x from 0 to the threshold. `None` without errors.
///
/// ```
/// assert_eq!(weaver_pose::auc([0.0, 15.0, 40.0], 30.0), Some(0.5));
/// ```
pub fn auc(errors: impl IntoIterator<Item = f64>, threshold: f64) -> Option<f64> {
    mean(errors.into_iter().map(|error| (1.0 - error / threshold).max(0.0)))
}
