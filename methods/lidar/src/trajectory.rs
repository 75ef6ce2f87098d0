//! Errors of trajectories.

use weaver_geometry::Pose;
use weaver_geometry::glam::{DMat3, DVec3};

/// Shares of the path over which relative errors are taken, percent.
const SHARES: [f64; 8] = [2.0, 3.0, 5.0, 8.0, 13.0, 21.0, 34.0, 55.0];

/// Errors of an estimated trajectory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrajectoryErrors {
    /// Root mean square distance of positions after the best rigid motion, meters.
    pub ate: f64,
    /// Root mean square distance of positions with equal first poses, meters.
    pub ate_first: f64,
    /// Root mean square error of relative translations of consecutive scans, meters.
    pub rpe: f64,
    /// Mean error of relative translations, percent of the length: over consecutive scans up to ten scans, else over
    /// the shares 2, 3, 5, 8, 13, 21, 34 and 55 % of the path. `None` for a reference without motion.
    pub rpe_percent: Option<f64>,
    /// Root mean square error of relative rotations of consecutive scans, degrees.
    pub rpe_degrees: f64,
    /// Length of the reference, meters.
    pub length: f64,
}

/// Compares poses (sensor to world) with as many others.
///
/// # Panics
///
/// If the numbers of poses differ or there are fewer than two.
///
/// ```
/// use weaver_geometry::{Pose, glam::{DMat3, DVec3}};
/// let path: Vec<Pose> = (0..5).map(|i| Pose::new(DMat3::IDENTITY, DVec3::X * i as f64)).collect();
/// let turned = Pose::new(DMat3::from_rotation_z(1.0), DVec3::Y);
/// let moved: Vec<Pose> = path.iter().map(|pose| turned.compose(pose)).collect();
/// let errors = weaver_lidar::trajectory_errors(&moved, &path);
/// assert!(errors.ate < 1e-9 && errors.rpe < 1e-9 && errors.length == 4.0);
/// ```
pub fn trajectory_errors(estimate: &[Pose], reference: &[Pose]) -> TrajectoryErrors {
    assert!(estimate.len() == reference.len() && estimate.len() >= 2, "as many poses, at least two");
    let n = estimate.len() as f64;
    let steps = reference.windows(2).map(|pair| pair[0].translation.distance(pair[1].translation));
    let path: Vec<f64> = std::iter::once(0.0)
        .chain(steps.scan(0.0, |sum, x| {
            *sum += x;
            Some(*sum)
        }))
        .collect();
    let length = path[path.len() - 1];
    let relative = |i: usize, j: usize| {
        let of = |poses: &[Pose]| poses[i].inverse().compose(&poses[j]);
        of(reference).inverse().compose(&of(estimate))
    };
    let consecutive: Vec<Pose> = (1..estimate.len()).map(|j| relative(j - 1, j)).collect();
    let root = |sum: f64, count: f64| (sum / count).sqrt();
    let rpe = root(consecutive.iter().map(|e| e.translation.length_squared()).sum(), n - 1.0);
    let turn = |e: &Pose| e.angle_to(&Pose::IDENTITY).to_degrees();
    let rpe_degrees = root(consecutive.iter().map(|e| turn(e).powi(2)).sum(), n - 1.0);
    let mut ratios = Vec::new();
    if estimate.len() <= 10 {
        let lengths = path.windows(2).map(|pair| pair[1] - pair[0]);
        ratios
            .extend(consecutive.iter().zip(lengths).filter(|(_, l)| *l > 0.0).map(|(e, l)| e.translation.length() / l));
    } else if length > 0.0 {
        for share in SHARES {
            let delta = share / 100.0 * length;
            for i in 0..estimate.len() {
                let Some(j) = (i + 1..estimate.len()).find(|j| path[*j] - path[i] >= delta) else { break };
                ratios.push(relative(i, j).translation.length() / (path[j] - path[i]));
            }
        }
    }
    let aligned = alignment(estimate, reference);
    let distance = |motion: &Pose| {
        let pairs = estimate.iter().zip(reference);
        root(pairs.map(|(e, r)| motion.apply(e.translation).distance_squared(r.translation)).sum(), n)
    };
    TrajectoryErrors {
        ate: distance(&aligned),
        ate_first: distance(&reference[0].compose(&estimate[0].inverse())),
        rpe,
        rpe_percent: (!ratios.is_empty()).then(|| 100.0 * ratios.iter().sum::<f64>() / ratios.len() as f64),
        rpe_degrees,
        length,
    }
}

/// The rigid motion that brings positions nearest to others, by Horn's quaternion; for positions on a line, the
/// undetermined turn comes from the first pose.
pub fn alignment(estimate: &[Pose], reference: &[Pose]) -> Pose {
    let mean = |poses: &[Pose]| poses.iter().map(|p| p.translation).sum::<DVec3>() / poses.len() as f64;
    let centers = [mean(estimate), mean(reference)];
    let mut m = DMat3::ZERO;
    for (e, r) in estimate.iter().zip(reference) {
        let (e, r) = (e.translation - centers[0], r.translation - centers[1]);
        m += DMat3::from_cols(e * r.x, e * r.y, e * r.z);
    }
    // s[i][j] = sum e_i r_j
    let s = |i: usize, j: usize| m.col(j)[i];
    let (a, b, c) = (s(1, 2) - s(2, 1), s(2, 0) - s(0, 2), s(0, 1) - s(1, 0));
    let k = [
        [s(0, 0) + s(1, 1) + s(2, 2), a, b, c],
        [a, s(0, 0) - s(1, 1) - s(2, 2), s(0, 1) + s(1, 0), s(2, 0) + s(0, 2)],
        [b, s(0, 1) + s(1, 0), s(1, 1) - s(0, 0) - s(2, 2), s(1, 2) + s(2, 1)],
        [c, s(2, 0) + s(0, 2), s(1, 2) + s(2, 1), s(2, 2) - s(0, 0) - s(1, 1)],
    ];
    let (values, vectors) = crate::eigen::symmetric(k);
    let rotation = match values[3] - values[2] > 1e-9 * values[3].abs() {
        true => Pose::from_wxyz(vectors[3], DVec3::ZERO).rotation,
        false => reference[0].rotation * estimate[0].rotation.transpose(),
    };
    Pose::new(rotation, centers[1] - rotation * centers[0])
}
