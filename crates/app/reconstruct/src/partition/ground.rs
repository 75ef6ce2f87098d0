//! The plane of the cameras.

use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;

/// Length of the mean of the cameras' unit vectors upward below which they agree on no upward direction.
const UPRIGHT: f64 = 0.5;

/// Two orthogonal unit vectors along the ground: first the one along which camera centers spread most.
///
/// Upward is the mean of the cameras' upward axes. Where photos were taken every way around, the ground is the plane
/// of x and y.
///
/// ```
/// use weaver_reconstruct::partition::ground_axes;
/// use weaver_geometry::{Pose, glam::DVec3};
/// // Cameras side by side that look along z, with y downward.
/// let poses = [0.0, 1.0, 2.0].map(|x| Pose { translation: DVec3::new(-x, 0.0, 0.0), ..Pose::IDENTITY });
/// let [first, second] = ground_axes(&poses);
/// assert!(first.x.abs() > 0.999 && second.z.abs() > 0.999);
/// ```
pub fn ground_axes(poses: &[Pose]) -> [DVec3; 2] {
    let count = poses.len().max(1) as f64;
    let up = poses.iter().map(|pose| -pose.rotation.row(1)).sum::<DVec3>() / count;
    let up = if up.length() > UPRIGHT { up.normalize() } else { DVec3::Z };
    let (x, y) = up.any_orthonormal_pair();
    let middle = poses.iter().map(Pose::center).sum::<DVec3>() / count;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for pose in poses {
        let from = pose.center() - middle;
        let (a, b) = (from.dot(x), from.dot(y));
        (xx, xy, yy) = (xx + a * a, xy + a * b, yy + b * b);
    }
    // The larger eigenvector of a symmetric 2 x 2 matrix.
    let (sin, cos) = (0.5 * f64::atan2(2.0 * xy, xx - yy)).sin_cos();
    [x * cos + y * sin, y * cos - x * sin]
}
