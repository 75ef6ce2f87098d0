//! Eigenvalues of small symmetric matrices.

use weaver_geometry::glam::{DMat3, DVec3};
use weaver_kernels::dense::symmetric_eigen;

/// Most rounds of rotations; hardly ten are needed.
const SWEEPS: usize = 50;

/// Eigenvalues, ascending, and eigenvectors (`vectors[i]` belongs to `values[i]`) of a symmetric matrix.
pub(crate) fn symmetric<const N: usize>(mut a: [[f64; N]; N]) -> ([f64; N], [[f64; N]; N]) {
    let mut v = [[0.0; N]; N];
    let scale: f64 = a.iter().flatten().map(|x| x.abs()).fold(0.0, f64::max);
    // NaN and infinities end the rotations, too.
    let settled = |a: &[f64]| {
        let below = (0..N).flat_map(|i| (0..i).map(move |j| a[i * N + j].abs()));
        let off: f64 = below.fold(0.0, f64::max);
        off <= 1e-15 * scale || off.is_nan()
    };
    symmetric_eigen(a.as_flattened_mut(), v.as_flattened_mut(), SWEEPS, settled);
    let mut order: [usize; N] = std::array::from_fn(|i| i);
    order.sort_by(|i, j| a[*i][*i].total_cmp(&a[*j][*j]));
    (order.map(|i| a[i][i]), order.map(|i| v[i]))
}

/// Mean and eigenvectors of the covariance of points, smallest first.
pub(crate) fn principal(points: impl Iterator<Item = DVec3> + Clone) -> (DVec3, [f64; 3], [DVec3; 3]) {
    let (count, sum) = points.clone().fold((0.0, DVec3::ZERO), |(count, sum), p| (count + 1.0, sum + p));
    let mean = sum / count;
    let mut covariance = DMat3::ZERO;
    for p in points {
        let d = p - mean;
        covariance += DMat3::from_cols(d * d.x, d * d.y, d * d.z);
    }
    let (values, vectors) = symmetric((covariance * (1.0 / count)).to_cols_array_2d());
    (mean, values, vectors.map(DVec3::from_array))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_are_turned_into_their_multiples() {
        let m = [[4.0, 1.0, -2.0, 0.5], [1.0, 3.0, 0.0, 0.1], [-2.0, 0.0, 1.0, 1.0], [0.5, 0.1, 1.0, -2.0]];
        let (values, vectors) = symmetric(m);
        assert!(values.is_sorted());
        for (value, vector) in values.iter().zip(&vectors) {
            for (row, x) in m.iter().zip(vector) {
                let product: f64 = row.iter().zip(vector).map(|(a, b)| a * b).sum();
                assert!((product - value * x).abs() < 1e-12);
            }
        }
        assert_eq!(symmetric([[0.0; 3]; 3]).0, [0.0; 3]);
    }
}
