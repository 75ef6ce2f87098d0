//! Transforms of Gaussians by nodes of other programs' scenes, which may stretch axes differently.

use weaver_geometry::Similarity;
use weaver_geometry::glam::{DMat3, DMat4, DQuat, DVec3};
use weaver_scene::Gaussians;

/// Largest difference from a rotation and scales, in ratios of scales and in angles.
const TOLERANCE: f64 = 1e-4;

/// Scales along axes, then a rotation, then a translation.
#[derive(Clone, Copy)]
pub(super) enum Placement {
    Similarity(Similarity),
    /// With several scales.
    Stretch {
        rotation: DMat3,
        scales: DVec3,
        translation: DVec3,
    },
}

impl Placement {
    /// The placement that a matrix of columns stands for; `None` of one that shears, mirrors or flattens.
    pub(super) fn of(matrix: &DMat4) -> Option<Self> {
        let linear = DMat3::from_mat4(*matrix);
        let scales = DVec3::from_array([0, 1, 2].map(|i| linear.col(i).length()));
        let rotation = linear * DMat3::from_diagonal(scales.recip());
        let straight = (rotation.transpose() * rotation).abs_diff_eq(DMat3::IDENTITY, TOLERANCE);
        let affine = matrix.row(3).abs_diff_eq(DMat4::IDENTITY.row(3), TOLERANCE);
        let usable = matrix.is_finite() && linear.determinant() > 0.0;
        let translation = matrix.w_axis.truncate();
        let scale = linear.determinant().cbrt();
        (usable && straight && affine).then_some(if (scales / scale).abs_diff_eq(DVec3::ONE, TOLERANCE) {
            Self::Similarity(Similarity { scale, rotation: linear * (1.0 / scale), translation })
        } else {
            Self::Stretch { rotation, scales, translation }
        })
    }

    /// The Gaussians where they are placed. Harmonics turn by the rotation alone.
    pub(super) fn apply(&self, gaussians: &Gaussians) -> Gaussians {
        let (rotation, scales, translation) = match *self {
            Self::Similarity(to) => return gaussians.transformed(&to),
            Self::Stretch { rotation, scales, translation } => (rotation, scales, translation),
        };
        let mut placed = gaussians.transformed(&Similarity { scale: 1.0, rotation, translation: DVec3::ZERO });
        let linear = rotation * DMat3::from_diagonal(scales);
        for i in 0..gaussians.len() {
            let mean = DVec3::from(gaussians.means[i].map(f64::from));
            placed.means[i] = (linear * mean + translation).as_vec3().to_array();
            let [w, x, y, z] = gaussians.quats[i].map(f64::from);
            let turn = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
            let deviations = DVec3::from(gaussians.log_scales[i].map(|s| f64::from(s).exp()));
            let (axes, deviations) = principal(linear * turn * DMat3::from_diagonal(deviations));
            let q = DQuat::from_mat3(&axes);
            placed.quats[i] = [q.w, q.x, q.y, q.z].map(|x| x as f32);
            placed.log_scales[i] = deviations.map(|s| s.max(f64::from(f32::MIN_POSITIVE)).ln() as f32);
        }
        placed
    }
}

/// The principal axes, as columns of a rotation, and standard deviations of a Gaussian of covariance `C C^T`, for C of
/// positive determinant: singular vectors and values by one-sided Jacobi rotations (Hestenes, 1958).
fn principal(c: DMat3) -> (DMat3, [f64; 3]) {
    /// Convergence is quadratic.
    const SWEEPS: usize = 12;
    let mut columns = [c.x_axis, c.y_axis, c.z_axis];
    for [p, q] in [[0, 1], [0, 2], [1, 2]].repeat(SWEEPS) {
        let (a, b) = (columns[p], columns[q]);
        let across = a.dot(b);
        if across.abs() > f64::EPSILON * a.length() * b.length() {
            let ratio = (b.length_squared() - a.length_squared()) / (2.0 * across);
            let tangent = ratio.signum() / (ratio.abs() + ratio.hypot(1.0));
            let cosine = 1.0 / tangent.hypot(1.0);
            let sine = cosine * tangent;
            (columns[p], columns[q]) = (cosine * a - sine * b, sine * a + cosine * b);
        }
    }
    let [x, y, z] = columns.map(|column| column.normalize());
    (DMat3::from_cols(x, y, z), columns.map(|column| column.length()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn principal_axes_keep_the_covariance() {
        let turn = |angle| DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), angle));
        for deviations in [DVec3::new(1.0, 2.0, 3.0), DVec3::new(1e-3, 1.0, 1.0), DVec3::ONE] {
            let c = DMat3::from_diagonal(DVec3::new(0.5, 3.0, 1.0)) * turn(0.9) * DMat3::from_diagonal(deviations);
            let (axes, found) = principal(c);
            let back = axes * DMat3::from_diagonal(DVec3::from(found));
            assert!((back * back.transpose()).abs_diff_eq(c * c.transpose(), 1e-12));
            assert!((axes * axes.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-12) && axes.determinant() > 0.0);
        }
    }
}
