//! Dense algebra of small systems in `f64`: matrices are square slices, row by row, and change in place.
//!
//! The order of operations is part of each function: what uses them keeps its bits.

/// Cholesky's factor L of a symmetric positive definite matrix, `A = L L^T`, in place of its lower triangle; `false`
/// where it is not positive definite.
///
/// Rows of `n` numbers begin `stride` numbers apart. The upper triangle is neither read nor written.
///
/// ```
/// use weaver_kernels::dense::{cholesky, cholesky_solve};
/// let mut matrix = [4.0, 0.0, 2.0, 5.0];
/// assert!(cholesky(&mut matrix, 2, 2));
/// assert_eq!(matrix, [2.0, 0.0, 1.0, 2.0]);
/// let mut x = [8.0, 12.0];
/// cholesky_solve(&matrix, &mut x);
/// assert_eq!(x, [1.0, 2.0]);
/// ```
#[inline]
pub fn cholesky(matrix: &mut [f64], n: usize, stride: usize) -> bool {
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| matrix[stride * i + k] * matrix[stride * j + k]).sum();
            let rest = matrix[stride * i + j] - sum;
            if j < i {
                matrix[stride * i + j] = rest / matrix[stride * j + j];
            } else if rest > 0.0 {
                matrix[stride * i + i] = rest.sqrt();
            } else {
                // Also for what is not a number.
                return false;
            }
        }
    }
    true
}

/// The solution of `L L^T x = b` for the factor `[n, n]` of [`cholesky`]; x replaces b.
#[inline]
pub fn cholesky_solve(factor: &[f64], x: &mut [f64]) {
    let n = x.len();
    for i in 0..n {
        let sum: f64 = (0..i).map(|k| factor[i * n + k] * x[k]).sum();
        x[i] = (x[i] - sum) / factor[i * n + i];
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| factor[k * n + i] * x[k]).sum();
        x[i] = (x[i] - sum) / factor[i * n + i];
    }
}

/// The solution of `A x = b` by Gauss's elimination without pivoting; x replaces b.
///
/// `sound` judges the pivot of each row, by its number, before it divides; where one is not sound, all ends with
/// `false`.
///
/// ```
/// let (mut matrix, mut x) = ([2.0, 1.0, 1.0, 3.0], [4.0, 7.0]);
/// assert!(weaver_kernels::dense::gauss(&mut matrix, &mut x, |_, pivot| pivot > 0.0));
/// assert_eq!(x, [1.0, 2.0]);
/// ```
#[inline]
pub fn gauss(matrix: &mut [f64], x: &mut [f64], sound: impl Fn(usize, f64) -> bool) -> bool {
    let n = x.len();
    for i in 0..n {
        let pivot = matrix[i * n + i];
        if !sound(i, pivot) {
            return false;
        }
        for row in i + 1..n {
            let factor = matrix[row * n + i] / pivot;
            (i..n).for_each(|k| matrix[row * n + k] -= factor * matrix[i * n + k]);
            x[row] -= factor * x[i];
        }
    }
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|k| matrix[i * n + k] * x[k]).sum();
        x[i] = (x[i] - known) / matrix[i * n + i];
    }
    true
}

/// The solution of `A X = B` for A `[n, n]` and B `[n, m]` by Gauss and Jordan's elimination without pivoting, which
/// divides each row by its pivot; X replaces B, and is the inverse of A for the identity.
///
/// `sound` judges the pivot of each row, by its number, before it divides; where one is not sound, all ends with
/// `false`.
///
/// ```
/// let (mut matrix, mut inverse) = ([2.0, 1.0, 1.0, 1.0], [1.0, 0.0, 0.0, 1.0]);
/// assert!(weaver_kernels::dense::gauss_jordan(&mut matrix, &mut inverse, 2, |_, pivot| pivot > 0.0));
/// assert_eq!(inverse, [1.0, -1.0, -1.0, 2.0]);
/// ```
#[inline]
pub fn gauss_jordan(matrix: &mut [f64], x: &mut [f64], n: usize, sound: impl Fn(usize, f64) -> bool) -> bool {
    let m = x.len() / n.max(1);
    for i in 0..n {
        let pivot = matrix[i * n + i];
        if !sound(i, pivot) {
            return false;
        }
        matrix[i * n..][..n].iter_mut().for_each(|x| *x /= pivot);
        x[i * m..][..m].iter_mut().for_each(|x| *x /= pivot);
        for row in (0..n).filter(|row| *row != i) {
            let factor = matrix[row * n + i];
            (0..n).for_each(|k| matrix[row * n + k] -= factor * matrix[i * n + k]);
            (0..m).for_each(|k| x[row * m + k] -= factor * x[i * m + k]);
        }
    }
    true
}

/// Eigenvectors of a symmetric matrix, `A v_i = l_i v_i`, as the rows of `vectors` `[n, n]`; the eigenvalues l_i take
/// the place of the diagonal, in no order. Jacobi's rotations, in cyclic order.
///
/// Ends before a sweep for which the matrix is `settled`, or after so many sweeps; they converge quadratically.
///
/// ```
/// let (mut matrix, mut vectors) = ([2.0, 1.0, 1.0, 2.0], [0.0; 4]);
/// weaver_kernels::dense::symmetric_eigen(&mut matrix, &mut vectors, 10, |matrix| matrix[1] == 0.0);
/// assert!((matrix[0] - 1.0).abs() < 1e-15 && (matrix[3] - 3.0).abs() < 1e-15);
/// assert!((vectors[0] + vectors[1]).abs() < 1e-15 && (vectors[2] - vectors[3]).abs() < 1e-15);
/// ```
///
/// # Panics
/// Unless both are square and of one size.
#[inline]
pub fn symmetric_eigen(matrix: &mut [f64], vectors: &mut [f64], sweeps: usize, settled: impl Fn(&[f64]) -> bool) {
    let n = matrix.len().isqrt();
    assert!(n * n == matrix.len() && vectors.len() == matrix.len(), "symmetric_eigen: two square matrices of one size");
    vectors.fill(0.0);
    (0..n).for_each(|i| vectors[i * n + i] = 1.0);
    for _ in 0..sweeps {
        if settled(matrix) {
            break;
        }
        for p in 0..n {
            for q in p + 1..n {
                let off = matrix[p * n + q];
                if off == 0.0 {
                    continue;
                }
                // The angle that zeroes the number at (p, q), the smaller of the two.
                let theta = (matrix[q * n + q] - matrix[p * n + p]) / (2.0 * off);
                let tangent = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let cos = 1.0 / tangent.hypot(1.0);
                let turn = [cos, tangent * cos];
                for row in matrix.chunks_exact_mut(n) {
                    [row[p], row[q]] = turned(turn, row[p], row[q]);
                }
                turn_rows(matrix, n, [p, q], turn);
                turn_rows(vectors, n, [p, q], turn);
            }
        }
    }
}

#[inline(always)]
fn turned([cos, sin]: [f64; 2], x: f64, y: f64) -> [f64; 2] {
    [cos * x - sin * y, sin * x + cos * y]
}

/// Rotates two rows, of which the second one is below the first.
#[inline(always)]
fn turn_rows(matrix: &mut [f64], n: usize, [p, q]: [usize; 2], turn: [f64; 2]) {
    let (above, below) = matrix.split_at_mut(q * n);
    for (x, y) in above[p * n..][..n].iter_mut().zip(&mut below[..n]) {
        [*x, *y] = turned(turn, *x, *y);
    }
}
