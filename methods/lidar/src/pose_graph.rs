//! Poses that agree best with measured motions between them.

use weaver_geometry::glam::DVec3;
use weaver_geometry::{Pose, se3};
use weaver_kernels::dense::{cholesky, cholesky_solve};

/// Most steps of Gauss-Newton.
const STEPS: usize = 20;

/// A measured motion between two poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Index of the first pose.
    pub from: usize,
    /// Index of the second pose.
    pub to: usize,
    /// The pose of `to` in the frame of `from`.
    pub motion: Pose,
    /// Weight of its squared error.
    pub weight: f64,
}

/// Moves poses (sensor to world) so that the sum over edges of w |log(Z^-1 X_from^-1 X_to)|^2 is least, with
/// Gauss-Newton on SE(3). The first pose stays; poses without an edge stay as well.
///
/// ```
/// use weaver_geometry::{Pose, glam::{DMat3, DVec3}};
/// use weaver_lidar::{Edge, optimize_poses};
/// let at = |x: f64| Pose::new(DMat3::IDENTITY, DVec3::X * x);
/// let mut poses = vec![at(0.0), at(1.0), at(2.3)];
/// let edge = |from, to, x| Edge { from, to, motion: at(x), weight: 1.0 };
/// optimize_poses(&mut poses, &[edge(0, 1, 1.0), edge(1, 2, 1.0), edge(0, 2, 2.3)]);
/// assert!((poses[1].translation.x - 1.1).abs() < 1e-9 && (poses[2].translation.x - 2.2).abs() < 1e-9);
/// ```
pub fn optimize_poses(poses: &mut [Pose], edges: &[Edge]) {
    let n = 6 * poses.len();
    for _ in 0..STEPS {
        let (mut h, mut b) = (vec![0.0; n * n], vec![0.0; n]);
        for edge in edges {
            add(edge, poses, &mut h, &mut b);
        }
        // Fixed poses: the first, and undetermined ones.
        for i in 0..n {
            if i < 6 || h[i * n + i] == 0.0 {
                (0..n).for_each(|k| (h[i * n + k], h[k * n + i]) = (0.0, 0.0));
                (h[i * n + i], b[i]) = (1.0, 0.0);
            }
            h[i * n + i] *= 1.0 + 1e-9;
        }
        let Some(step) = solved(h, &b) else { return };
        for (pose, step) in poses.iter_mut().zip(step.chunks_exact(6)) {
            let moved = pose.compose(&se3::exp(DVec3::from_slice(step), DVec3::from_slice(&step[3..])));
            *pose = Pose::from_wxyz(moved.wxyz(), moved.translation);
        }
        if step.iter().all(|x| x.abs() < 1e-10) {
            return;
        }
    }
}

/// Adds an edge: for X exp(d), the error grows by d_to - Ad(X_to^-1 X_from) d_from, up to terms of the order of the
/// error.
fn add(edge: &Edge, poses: &[Pose], h: &mut [f64], b: &mut [f64]) {
    let n = 6 * poses.len();
    let between = poses[edge.from].inverse().compose(&poses[edge.to]);
    let (v, w) = se3::log(&edge.motion.inverse().compose(&between));
    let error = [v.x, v.y, v.z, w.x, w.y, w.z];
    let back = between.inverse();
    let mut from = [[0.0; 6]; 6];
    for (axis, direction) in DVec3::AXES.into_iter().enumerate() {
        let turned = back.rotation * direction;
        let carried = back.translation.cross(turned);
        for k in 0..3 {
            from[k][axis] = -turned[k];
            from[k][3 + axis] = -carried[k];
            from[3 + k][3 + axis] = -turned[k];
        }
    }
    let to: [[f64; 6]; 6] = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    let parts = [(6 * edge.from, &from), (6 * edge.to, &to)];
    for (first, a) in parts {
        for i in 0..6 {
            b[first + i] += edge.weight * (0..6).map(|k| a[k][i] * error[k]).sum::<f64>();
            for (second, c) in parts {
                for j in 0..6 {
                    let sum: f64 = (0..6).map(|k| a[k][i] * c[k][j]).sum();
                    h[(first + i) * n + second + j] += edge.weight * sum;
                }
            }
        }
    }
}

/// The solution of H x = -b by Cholesky's factors; `None` if H is not positive definite.
fn solved(mut h: Vec<f64>, b: &[f64]) -> Option<Vec<f64>> {
    let mut x: Vec<f64> = b.iter().map(|b| -b).collect();
    cholesky(&mut h, x.len(), x.len()).then(|| {
        cholesky_solve(&h, &mut x);
        x
    })
}
