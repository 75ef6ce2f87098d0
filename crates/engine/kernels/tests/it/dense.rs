//! Dense algebra of small systems against elimination with the largest pivots, and against definitions.

use crate::noise;
use proptest::prelude::*;
use weaver_kernels::dense::{cholesky, cholesky_solve, gauss, gauss_jordan, symmetric_eigen};

/// `a b` of `[n, n]` and `[n, m]`.
fn product(a: &[f64], b: &[f64], n: usize) -> Vec<f64> {
    let m = b.len() / n;
    (0..n * m).map(|at| (0..n).map(|k| a[at / m * n + k] * b[k * m + at % m]).sum()).collect()
}

fn transposed(a: &[f64], n: usize) -> Vec<f64> {
    (0..n * n).map(|at| a[at % n * n + at / n]).collect()
}

/// A symmetric positive definite matrix.
fn definite(n: usize, seed: u64) -> Vec<f64> {
    let a: Vec<f64> = noise(n * n, seed);
    let mut matrix = product(&a, &transposed(&a, n), n);
    (0..n).for_each(|i| matrix[i * n + i] += 0.5);
    matrix
}

/// The slow twin: elimination with the largest pivot of each column, one right side after the other.
fn solved(matrix: &[f64], right: &[f64]) -> Vec<f64> {
    let n = right.len();
    let mut rows: Vec<Vec<f64>> =
        (0..n).map(|i| matrix[i * n..][..n].iter().copied().chain([right[i]]).collect()).collect();
    for i in 0..n {
        let pivot = (i..n).max_by(|a, b| rows[*a][i].abs().total_cmp(&rows[*b][i].abs())).expect("rows");
        rows.swap(i, pivot);
        for j in (0..n).filter(|j| *j != i) {
            let factor = rows[j][i] / rows[i][i];
            let above = rows[i].clone();
            rows[j].iter_mut().zip(above).for_each(|(x, y)| *x -= factor * y);
        }
    }
    (0..n).map(|i| rows[i][n] / rows[i][i]).collect()
}

fn close(found: &[f64], expected: &[f64], tolerance: f64) -> bool {
    let largest = expected.iter().fold(1.0_f64, |most, x| most.max(x.abs()));
    found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= tolerance * largest)
}

proptest! {
    #[test]
    fn systems_are_solved(n in 1_usize..9, seed: u64) {
        let (matrix, right) = (definite(n, seed), noise::<f64>(n, !seed));
        let expected = solved(&matrix, &right);

        let (mut factor, mut x) = (matrix.clone(), right.clone());
        prop_assert!(cholesky(&mut factor, n, n));
        cholesky_solve(&factor, &mut x);
        prop_assert!(close(&x, &expected, 1e-10), "Cholesky: {:?}, expected {:?}", x, expected);

        let mut x = right.clone();
        prop_assert!(gauss(&mut matrix.clone(), &mut x, |_, pivot| pivot > 0.0));
        prop_assert!(close(&x, &expected, 1e-10), "Gauss: {:?}, expected {:?}", x, expected);

        let mut x = right.clone();
        prop_assert!(gauss_jordan(&mut matrix.clone(), &mut x, n, |_, pivot| pivot > 0.0));
        prop_assert!(close(&x, &expected, 1e-10), "Gauss and Jordan: {:?}, expected {:?}", x, expected);
    }

    #[test]
    fn the_factor_is_a_root(n in 1_usize..9, more in 0_usize..4, seed: u64) {
        let (matrix, stride) = (definite(n, seed), n + more);
        let mut padded = vec![7.0; n * stride];
        (0..n * n).for_each(|at| padded[at / n * stride + at % n] = matrix[at]);
        let before = padded.clone();
        prop_assert!(cholesky(&mut padded, n, stride));
        let lower: Vec<f64> =
            (0..n * n).map(|at| if at % n <= at / n { padded[at / n * stride + at % n] } else { 0.0 }).collect();
        prop_assert!(close(&product(&lower, &transposed(&lower, n), n), &matrix, 1e-12));
        let untouched = |at: &usize| at % stride > at / stride;
        prop_assert!((0..n * stride).filter(untouched).all(|at| padded[at] == before[at]));
    }

    #[test]
    fn the_solution_for_the_identity_is_the_inverse(n in 1_usize..9, seed: u64) {
        let matrix = definite(n, seed);
        let identity: Vec<f64> = (0..n * n).map(|at| f64::from(at / n == at % n)).collect();
        let mut inverse = identity.clone();
        prop_assert!(gauss_jordan(&mut matrix.clone(), &mut inverse, n, |_, pivot| pivot > 0.0));
        prop_assert!(close(&product(&matrix, &inverse, n), &identity, 1e-9));
    }

    #[test]
    fn eigenvectors_are_turned_into_their_multiples(n in 1_usize..9, seed: u64) {
        let a: Vec<f64> = noise(n * n, seed);
        let symmetric: Vec<f64> = a.iter().zip(transposed(&a, n)).map(|(x, y)| x + y).collect();
        let (mut values, mut vectors) = (symmetric.clone(), vec![0.0; n * n]);
        symmetric_eigen(&mut values, &mut vectors, 30, |_| false);
        let turned = product(&symmetric, &transposed(&vectors, n), n);
        for (i, vector) in vectors.chunks_exact(n).enumerate() {
            let multiple: Vec<f64> = vector.iter().map(|x| values[i * n + i] * x).collect();
            let column: Vec<f64> = (0..n).map(|k| turned[k * n + i]).collect();
            prop_assert!(close(&column, &multiple, 1e-12));
            prop_assert!((vector.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn what_is_not_positive_definite_is_refused() {
    assert!(!cholesky(&mut [1.0, 0.0, 2.0, 1.0], 2, 2));
    assert!(!cholesky(&mut [0.0], 1, 1));
    assert!(!cholesky(&mut [f64::NAN], 1, 1));
    assert!(!gauss(&mut [1.0, 2.0, 2.0, 4.0], &mut [1.0, 1.0], |_, pivot| pivot > 0.0));
    assert!(!gauss_jordan(&mut [1.0, 2.0, 2.0, 4.0], &mut [1.0, 1.0], 2, |i, pivot| i == 0 || pivot > 0.0));
}

#[test]
fn a_settled_matrix_is_left_alone() {
    let (mut matrix, mut vectors) = ([2.0, 1.0, 1.0, 2.0], [5.0; 4]);
    symmetric_eigen(&mut matrix, &mut vectors, 10, |_| true);
    assert_eq!((matrix, vectors), ([2.0, 1.0, 1.0, 2.0], [1.0, 0.0, 0.0, 1.0]));
}
