//! Errors of estimated poses, independent of the choice of frame and scale; computed without a tape.

use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;

/// Baselines shorter than this have no direction worth comparing.
const SHORTEST_BASELINE: f64 = 1e-3;

/// Errors in degrees of the poses of a scene's views 1, 2, ... relative to its view 0.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseErrors {
    /// Angle between predicted and true rotation relative to camera 0.
    pub rotation: Vec<f64>,
    /// Angle between the predicted and the true direction from camera 0 to the camera's center. `None` where the true
    /// baseline is shorter than 1e-3; 180 where only the predicted one is, so that poses collapsed to one point do not
    /// score well.
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

    /// Mean translation error of the views that have one; `None` if no view does.
    pub fn mean_translation(&self) -> Option<f64> {
        mean(self.translation.iter().copied().flatten())
    }

    /// The larger of each view's two errors, as the area under the recall curve ([`auc`]) counts them.
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

/// The area under the recall curve of `errors` up to `threshold`, from 0 to 1; `None` without errors.
///
/// It is the mean of max(0, 1 - error / threshold), which equals the integral of the share of errors below x, over x
/// from 0 to the threshold, divided by the threshold.
///
/// ```
/// assert_eq!(weaver_pose::auc([0.0, 15.0, 40.0], 30.0), Some(0.5));
/// ```
pub fn auc(errors: impl IntoIterator<Item = f64>, threshold: f64) -> Option<f64> {
    mean(errors.into_iter().map(|error| (1.0 - error / threshold).max(0.0)))
}
