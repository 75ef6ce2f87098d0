//! The similarity transform that best lays one set of points over another.

use crate::Pose;
use glam::{DMat3, DQuat, DVec3};

/// A similarity transform: `x -> scale * rotation * x + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Similarity {
    /// Factor by which lengths grow, positive.
    pub scale: f64,
    /// Rotation matrix, determinant 1.
    pub rotation: DMat3,
    /// The image of the origin.
    pub translation: DVec3,
}

impl Similarity {
    /// The transform that minimizes `sum |to_i - transform(from_i)|^2`.
    ///
    /// `None` when it is not determined: fewer than three points, or all points (nearly) on one line.
    ///
    /// # Panics
    /// When the numbers of points differ.
    ///
    /// Sources: Umeyama, "Least-squares estimation of transformation parameters between two point patterns"
    /// (1991) for the problem and the scale; Horn, "Closed-form solution of absolute orientation using unit
    /// quaternions" (1987) for the rotation, which cannot come out as a reflection.
    pub fn fit(from: &[DVec3], to: &[DVec3]) -> Option<Self> {
        assert_eq!(from.len(), to.len(), "as many points from as to");
        if from.len() < 3 {
            return None;
        }
        let mean = |points: &[DVec3]| points.iter().sum::<DVec3>() / points.len() as f64;
        let (from_mean, to_mean) = (mean(from), mean(to));
        let mut covariance = DMat3::ZERO;
        let mut from_spread = 0.0;
        for (&f, &t) in from.iter().zip(to) {
            let (f, t) = (f - from_mean, t - to_mean);
            covariance += DMat3::from_cols(f * t.x, f * t.y, f * t.z);
            from_spread += f.length_squared();
        }
        let rotation = nearest_rotation(&covariance)?;
        let along: f64 = (from.iter().zip(to)).map(|(f, t)| (rotation * (*f - from_mean)).dot(*t - to_mean)).sum();
        let scale = along / from_spread;
        Some(Self { scale, rotation, translation: to_mean - rotation * from_mean * scale })
    }

    /// The transform without rotation that minimizes `sum weight_i |to_i - (scale from_i + translation)|^2 + ridge
    /// (scale^2 +
    /// |translation|^2)`.
    ///
    /// `None` when it is not determined, as by a single point without ridge, or when a number is not finite. The scale
    /// may come out negative. Source: Fujimura et al., WildSplatter, arXiv 2604.21182, which lays predicted points over
    /// the data's with a ridge of 1e-6.
    ///
    /// # Panics
    /// When the numbers of points and weights differ.
    ///
    /// ```
    /// use weaver_geometry::{Similarity, glam::DVec3};
    /// let from = [DVec3::ZERO, DVec3::X, DVec3::new(0.0, 2.0, 1.0)];
    /// let to = from.map(|x| x * 1.5 + DVec3::Y);
    /// let found = Similarity::fit_scale_and_shift(&from, &to, &[1.0, 0.5, 2.0], 0.0).unwrap();
    /// assert!((found.scale - 1.5).abs() < 1e-12 && (found.translation - DVec3::Y).length() < 1e-12);
    /// ```
    pub fn fit_scale_and_shift(from: &[DVec3], to: &[DVec3], weights: &[f64], ridge: f64) -> Option<Self> {
        assert!(
            from.len() == to.len() && from.len() == weights.len(),
            "as many points from as to, and as many weights"
        );
        let all = || from.iter().zip(to).zip(weights).map(|((from, to), weight)| (*from, *to, *weight));
        let weight = weights.iter().sum::<f64>() + ridge;
        let from_sum: DVec3 = all().map(|(from, _, w)| from * w).sum();
        let to_sum: DVec3 = all().map(|(_, to, w)| to * w).sum();
        let spread = all().map(|(from, _, w)| w * from.length_squared()).sum::<f64>() + ridge;
        let along: f64 = all().map(|(from, to, w)| w * from.dot(to)).sum();
        // The shift is eliminated, which leaves one equation for the scale.
        let left = spread - from_sum.length_squared() / weight;
        let scale = (along - from_sum.dot(to_sum) / weight) / left;
        let translation = (to_sum - from_sum * scale) / weight;
        let determined = left > f64::EPSILON * spread && scale.is_finite() && translation.is_finite();
        determined.then_some(Self { scale, rotation: DMat3::IDENTITY, translation })
    }

    /// The transform from one reconstruction's world to another's, found from the poses of their cameras: the rotation
    /// minimizes `sum |R_to rotation - R_from|^2`, scale and translation then lay the centers on one another.
    ///
    /// Axes say far better than centers how a world is turned where cameras stand close together, and two cameras are
    /// enough. `None` when all centers are the same, or there are none.
    ///
    /// # Panics
    /// When the numbers of poses differ.
    ///
    /// Source for the rotation: Horn, 1987, with axes in place of points.
    pub fn fit_poses(from: &[Pose], to: &[Pose]) -> Option<Self> {
        assert_eq!(from.len(), to.len(), "as many poses from as to");
        let mut covariance = DMat3::ZERO;
        for (f, t) in from.iter().zip(to) {
            // Sum over axes of the outer products of their directions in both worlds.
            covariance += f.rotation.transpose() * t.rotation;
        }
        let rotation = nearest_rotation(&covariance)?;
        let mean = |poses: &[Pose]| poses.iter().map(Pose::center).sum::<DVec3>() / poses.len() as f64;
        let (from_mean, to_mean) = (mean(from), mean(to));
        let (mut along, mut spread) = (0.0, 0.0);
        for (f, t) in from.iter().zip(to) {
            let f = rotation * (f.center() - from_mean);
            along += f.dot(t.center() - to_mean);
            spread += f.length_squared();
        }
        let scale = along / spread;
        (scale > 0.0).then(|| Self { scale, rotation, translation: to_mean - rotation * from_mean * scale })
    }

    /// Maps a point into the other world.
    pub fn apply(&self, point: DVec3) -> DVec3 {
        self.rotation * point * self.scale + self.translation
    }

    /// Maps a camera into the other world: its center and its axes are carried over.
    pub fn apply_to_pose(&self, pose: &Pose) -> Pose {
        let rotation = pose.rotation * self.rotation.transpose();
        Pose::new(rotation, -(rotation * self.apply(pose.center())))
    }
}

/// The rotation R that maximizes `sum t . R f`, from `covariance[i][j] = sum f_i t_j`; `None` where several do.
fn nearest_rotation(covariance: &DMat3) -> Option<DMat3> {
    let (values, vectors) = symmetric_eigen(horn(covariance));
    let mut order = [0, 1, 2, 3];
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
    let (best, next) = (order[0], order[1]);
    let largest = values.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    // On a line, turning about it changes nothing: two eigenvalues coincide. (Also not passed by NaN.)
    let determined = values[best] - values[next] > 1e-9 * largest;
    let [w, x, y, z] = std::array::from_fn(|i| vectors[i][best]);
    determined.then(|| DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize()))
}

/// Horn's symmetric matrix, whose quadratic form over unit quaternions wxyz is `sum t . R(q) f`,
/// from `covariance[i][j] = sum f_i t_j`.
fn horn(covariance: &DMat3) -> [[f64; 4]; 4] {
    let s = |i: usize, j: usize| covariance.col(j)[i];
    let off = [s(1, 2) - s(2, 1), s(2, 0) - s(0, 2), s(0, 1) - s(1, 0)];
    let trace = s(0, 0) + s(1, 1) + s(2, 2);
    std::array::from_fn(|r| {
        std::array::from_fn(|c| match (r, c) {
            (0, 0) => trace,
            (0, i) | (i, 0) => off[i - 1],
            (i, j) => s(i - 1, j - 1) + s(j - 1, i - 1) - if i == j { trace } else { 0.0 },
        })
    })
}

/// Eigenvalues and eigenvectors (in columns) of a symmetric matrix, by Jacobi's rotations.
fn symmetric_eigen(mut a: [[f64; 4]; 4]) -> ([f64; 4], [[f64; 4]; 4]) {
    let mut vectors: [[f64; 4]; 4] = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(i == j)));
    // Convergence is quadratic; a 4x4 matrix is at the last bit after four or five sweeps.
    for _ in 0..12 {
        for p in 0..3 {
            for q in p + 1..4 {
                if a[p][q] == 0.0 {
                    continue;
                }
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let cos = 1.0 / t.hypot(1.0);
                let sin = t * cos;
                for row in &mut a {
                    (row[p], row[q]) = (cos * row[p] - sin * row[q], sin * row[p] + cos * row[q]);
                }
                #[expect(clippy::needless_range_loop, reason = "two rows of one matrix change together")]
                for k in 0..4 {
                    (a[p][k], a[q][k]) = (cos * a[p][k] - sin * a[q][k], sin * a[p][k] + cos * a[q][k]);
                }
                for row in &mut vectors {
                    (row[p], row[q]) = (cos * row[p] - sin * row[q], sin * row[p] + cos * row[q]);
                }
            }
        }
    }
    (std::array::from_fn(|i| a[i][i]), vectors)
}
