//! Shapes of Gaussians without their size, and back.

use weaver_geometry::glam::{DMat3, DQuat, DVec3};
use weaver_scene::Gaussians;

/// Least share of an axis in the trace: thinner ones look the same.
const THINNEST: f64 = 1e-8;

/// Sweeps of Jacobi rotations, which converge quadratically.
const SWEEPS: usize = 12;

/// Half the logarithm of the trace of a Gaussian's covariance, and the covariance over the trace: xx, xy, xz, yy, yz,
/// zz.
pub(crate) fn normalized(gaussians: &Gaussians, i: usize) -> (f32, [f32; 6]) {
    let logs = gaussians.log_scales[i].map(f64::from);
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let shares = logs.map(|log| (2.0 * (log - largest)).exp());
    let trace: f64 = shares.iter().sum();
    let [w, x, y, z] = gaussians.quats[i].map(f64::from);
    let quat = DQuat::from_xyzw(x, y, z, w);
    let turn = DMat3::from_quat(if quat.length_squared() > 0.0 { quat.normalize() } else { DQuat::IDENTITY });
    let m = turn * DMat3::from_diagonal(DVec3::from(shares.map(|share| share / trace))) * turn.transpose();
    let row = [m.x_axis.x, m.x_axis.y, m.x_axis.z, m.y_axis.y, m.y_axis.z, m.z_axis.z];
    ((largest + 0.5 * trace.ln()) as f32, row.map(|x| x as f32))
}

/// Log scales and rotation of a size and shape.
pub(crate) fn decomposed(size: f32, shape: &[f32; 6]) -> ([f32; 3], [f32; 4]) {
    let [xx, xy, xz, yy, yz, zz] = shape.map(f64::from);
    let (values, mut axes) = eigen([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]);
    if DMat3::from_cols_array_2d(&axes).determinant() < 0.0 {
        axes[2] = axes[2].map(|x| -x);
    }
    let quat = DQuat::from_mat3(&DMat3::from_cols_array_2d(&axes)).normalize();
    let scales = values.map(|value| (f64::from(size) + 0.5 * value.max(THINNEST).ln()) as f32);
    (scales, [quat.w, quat.x, quat.y, quat.z].map(|x| x as f32))
}

/// Eigenvalues and eigenvectors, one a row, of a symmetric matrix, by cyclic Jacobi rotations.
fn eigen(mut m: [[f64; 3]; 3]) -> ([f64; 3], [[f64; 3]; 3]) {
    let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for (p, q) in [(0, 1), (0, 2), (1, 2)].into_iter().cycle().take(3 * SWEEPS) {
        if m[p][q] == 0.0 {
            continue;
        }
        let theta = (m[q][q] - m[p][p]) / (2.0 * m[p][q]);
        let tangent = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
        let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
        let sine = tangent * cosine;
        let turn = |a: f64, b: f64| (cosine * a - sine * b, sine * a + cosine * b);
        for row in &mut m {
            (row[p], row[q]) = turn(row[p], row[q]);
        }
        for k in 0..3 {
            (m[p][k], m[q][k]) = turn(m[p][k], m[q][k]);
            (axes[p][k], axes[q][k]) = turn(axes[p][k], axes[q][k]);
        }
    }
    ([m[0][0], m[1][1], m[2][2]], axes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_come_back() {
        let gaussians = Gaussians {
            means: vec![[0.0; 3]; 3],
            log_scales: vec![[-1.0, -3.0, -2.0], [2.0, 2.0, 2.0], [0.0, 0.5, -4.0]],
            quats: vec![[0.3, -0.2, 0.9, 0.4], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 2.0]],
            opacity_logits: vec![0.0; 3],
            sh: vec![0.0; 9],
            degree: 0,
        };
        let mut again = gaussians.clone();
        for i in 0..3 {
            let (size, shape) = normalized(&gaussians, i);
            (again.log_scales[i], again.quats[i]) = decomposed(size, &shape);
            let (size_again, shape_again) = normalized(&again, i);
            assert!((size - size_again).abs() < 1e-5);
            assert!(shape.iter().zip(shape_again).all(|(a, b)| (a - b).abs() < 1e-6), "{shape:?} {shape_again:?}");
        }
    }
}
