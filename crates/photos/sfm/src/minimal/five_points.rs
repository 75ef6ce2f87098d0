//! Relative poses from five matches.

use super::polynomial::roots;
use weaver_geometry::glam::{DMat3, DVec3};

/// Monomials of degree three at most in x, y, z, by exponents: those that are eliminated, then those that stay.
const CUBIC: [[u8; 3]; 20] = [
    [3, 0, 0],
    [0, 3, 0],
    [2, 1, 0],
    [1, 2, 0],
    [2, 0, 1],
    [2, 0, 0],
    [0, 2, 1],
    [0, 2, 0],
    [1, 1, 1],
    [1, 1, 0],
    [1, 0, 2],
    [1, 0, 1],
    [1, 0, 0],
    [0, 1, 2],
    [0, 1, 1],
    [0, 1, 0],
    [0, 0, 3],
    [0, 0, 2],
    [0, 0, 1],
    [0, 0, 0],
];
/// Of degree two at most, and one.
const QUADRATIC: [[u8; 3]; 10] =
    [[2, 0, 0], [1, 1, 0], [0, 2, 0], [1, 0, 1], [0, 1, 1], [0, 0, 2], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]];
const LINEAR: [[u8; 3]; 4] = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]];
/// Index of the monomial that is the product of two.
const LINEAR_SQUARED: [[usize; 4]; 4] = products(&LINEAR, &QUADRATIC);
const QUADRATIC_TIMES_LINEAR: [[usize; 4]; 10] = products(&QUADRATIC, &CUBIC);

const fn products<const N: usize, const M: usize>(of: &[[u8; 3]; N], among: &[[u8; 3]; M]) -> [[usize; 4]; N] {
    let mut places = [[0; 4]; N];
    let mut i = 0;
    while i < N {
        let mut j = 0;
        while j < 4 {
            let mut k = 0;
            while among[k][0] != of[i][0] + LINEAR[j][0]
                || among[k][1] != of[i][1] + LINEAR[j][1]
                || among[k][2] != of[i][2] + LINEAR[j][2]
            {
                k += 1;
            }
            places[i][j] = k;
            j += 1;
        }
        i += 1;
    }
    places
}

type Linear = [f64; 4];
type Quadratic = [f64; 10];
type Cubic = [f64; 20];

/// Adds `factor` a b to a polynomial.
fn add_product(to: &mut Quadratic, factor: f64, a: &Linear, b: &Linear) {
    for (x, places) in a.iter().zip(&LINEAR_SQUARED) {
        b.iter().zip(places).for_each(|(y, place)| to[*place] += factor * x * y);
    }
}

fn add_cubic(to: &mut Cubic, a: &Quadratic, b: &Linear) {
    for (x, places) in a.iter().zip(&QUADRATIC_TIMES_LINEAR) {
        b.iter().zip(places).for_each(|(y, place)| to[*place] += x * y);
    }
}

/// The essential matrices E with y . E x = 0 for five matches [x, y] of rays, up to ten.
///
/// Source: Nistér, "An efficient solution to the five-point relative pose problem" (2004).
pub(crate) fn five_points(matches: &[[DVec3; 2]; 5]) -> Vec<DMat3> {
    let Some(basis) = null_space(matches) else { return Vec::new() };
    // E as a matrix of polynomials in x, y, z: entry [row][column].
    let entry: [[Linear; 3]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| basis.map(|b| b[3 * r + c])));
    let Some(eliminated) = eliminated(constraints(&entry)) else { return Vec::new() };
    // Rows 4 to 9 in pairs: the first less z times the second has x and y of degree one only, with coefficients in z.
    let rows: [[[f64; 5]; 3]; 3] = std::array::from_fn(|k| {
        let (e, f) = (&eliminated[4 + 2 * k], &eliminated[5 + 2 * k]);
        [
            [e[12], e[11] - f[12], e[10] - f[11], -f[10], 0.0],
            [e[15], e[14] - f[15], e[13] - f[14], -f[13], 0.0],
            [e[19], e[18] - f[19], e[17] - f[18], e[16] - f[17], -f[16]],
        ]
    });
    let mut determinant = [0.0; 11];
    for [a, b, c] in [[0, 1, 2], [1, 2, 0], [2, 0, 1]] {
        for (i, x) in rows[a][0].iter().enumerate().take(4) {
            for (j, y) in rows[b][1].iter().enumerate().take(4) {
                rows[c][2].iter().enumerate().for_each(|(k, z)| determinant[i + j + k] += x * y * z);
            }
            for (j, y) in rows[c][1].iter().enumerate().take(4) {
                rows[b][2].iter().enumerate().for_each(|(k, z)| determinant[i + j + k] -= x * y * z);
            }
        }
    }
    let essential = |z: f64| {
        let at = |of: &[f64; 5]| of.iter().rev().fold(0.0, |sum, c| sum * z + c);
        let [a, b, c] = rows.each_ref().map(|row| DVec3::new(at(&row[0]), at(&row[1]), at(&row[2])));
        let normals = [a.cross(b), b.cross(c), c.cross(a)];
        let normal = normals.into_iter().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))?;
        let [x, y] = [normal.x / normal.z, normal.y / normal.z];
        let number = |i: usize| basis[0][i] * x + basis[1][i] * y + basis[2][i] * z + basis[3][i];
        let matrix = DMat3::from_cols_array(&std::array::from_fn(|i| number(3 * (i % 3) + i / 3)));
        matrix.is_finite().then_some(matrix)
    };
    roots(&determinant).into_iter().filter_map(essential).collect()
}

/// Four orthonormal solutions of y . E x = 0, row by row.
fn null_space(matches: &[[DVec3; 2]; 5]) -> Option<[[f64; 9]; 4]> {
    let mut rows: [[f64; 9]; 5] = matches.map(|[x, y]| {
        let (x, y) = (x.to_array(), y.to_array());
        std::array::from_fn(|i| y[i / 3] * x[i % 3])
    });
    // The columns by which rows are eliminated.
    let mut pivots = [0; 5];
    for k in 0..5 {
        let free = |column: &usize| !pivots[..k].contains(column);
        let columns = (k..5).flat_map(|row| (0..9).filter(free).map(move |column| (row, column)));
        let (row, column) = columns.max_by(|a, b| rows[a.0][a.1].abs().total_cmp(&rows[b.0][b.1].abs()))?;
        let pivot = rows[row][column];
        if pivot.abs() < 1e-12 {
            return None;
        }
        rows.swap(k, row);
        rows[k].iter_mut().for_each(|x| *x /= pivot);
        pivots[k] = column;
        let this = rows[k];
        for i in (0..5).filter(|i| *i != k) {
            let factor = rows[i][column];
            rows[i].iter_mut().zip(this).for_each(|(x, y)| *x -= factor * y);
        }
    }
    let mut basis = [[0.0; 9]; 4];
    let free = (0..9).filter(|column| !pivots.contains(column));
    for (vector, column) in basis.iter_mut().zip(free) {
        vector[column] = 1.0;
        pivots.iter().zip(&rows).for_each(|(pivot, row)| vector[*pivot] = -row[column]);
    }
    for k in 0..4 {
        for j in 0..k {
            let other = basis[j];
            let along: f64 = basis[k].iter().zip(other).map(|(a, b)| a * b).sum();
            basis[k].iter_mut().zip(other).for_each(|(a, b)| *a -= along * b);
        }
        let length = basis[k].iter().map(|x| x * x).sum::<f64>().sqrt();
        basis[k].iter_mut().for_each(|x| *x /= length);
    }
    Some(basis)
}

/// Conditions of an essential matrix: 2 E E^T E - tr(E E^T) E = 0, and that its determinant is 0.
fn constraints(entry: &[[Linear; 3]; 3]) -> [Cubic; 10] {
    // E E^T less half its trace on the diagonal.
    let mut square = [[[0.0; 10]; 3]; 3];
    for (r, c) in (0..3).flat_map(|r| (0..3).map(move |c| (r, c))) {
        (0..3).for_each(|k| add_product(&mut square[r][c], 1.0, &entry[r][k], &entry[c][k]));
    }
    let trace: Quadratic = std::array::from_fn(|i| square[0][0][i] + square[1][1][i] + square[2][2][i]);
    for (k, row) in square.iter_mut().enumerate() {
        row[k].iter_mut().zip(trace).for_each(|(x, t)| *x -= 0.5 * t);
    }
    let mut equations = [[0.0; 20]; 10];
    for (r, c) in (0..3).flat_map(|r| (0..3).map(move |c| (r, c))) {
        (0..3).for_each(|k| add_cubic(&mut equations[3 * r + c], &square[r][k], &entry[k][c]));
    }
    for (k, [a, b]) in [[1, 2], [2, 0], [0, 1]].into_iter().enumerate() {
        let mut minor = [0.0; 10];
        add_product(&mut minor, 1.0, &entry[1][a], &entry[2][b]);
        add_product(&mut minor, -1.0, &entry[1][b], &entry[2][a]);
        add_cubic(&mut equations[9], &minor, &entry[0][k]);
    }
    equations
}

/// The equations solved for their first ten monomials.
fn eliminated(mut rows: [Cubic; 10]) -> Option<[Cubic; 10]> {
    for k in 0..10 {
        let row = (k..10).max_by(|a, b| rows[*a][k].abs().total_cmp(&rows[*b][k].abs()))?;
        rows.swap(k, row);
        let pivot = rows[k][k];
        if pivot.abs() < 1e-14 {
            return None;
        }
        rows[k].iter_mut().for_each(|x| *x /= pivot);
        let this = rows[k];
        for row in (0..10).filter(|row| *row != k) {
            let factor = rows[row][k];
            rows[row][k..].iter_mut().zip(&this[k..]).for_each(|(x, y)| *x -= factor * y);
        }
    }
    Some(rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::so3;
    use weaver_kernels::random::Stream;

    /// The true essential matrix is among those that are found.
    #[test]
    fn the_true_essential_matrix_is_found() {
        let mut missed = 0;
        for seed in 0..300 {
            let stream = Stream::new(seed, 0, "test.five_points");
            let draw = |k: u64| DVec3::new(stream.normal(k), stream.normal(k + 1), stream.normal(k + 2));
            let (rotation, translation) = (so3::exp(0.5 * draw(0)), draw(3).normalize());
            let matches: [[DVec3; 2]; 5] = std::array::from_fn(|k| {
                let point = draw(10 + 3 * k as u64) + DVec3::Z * 6.0;
                let there = rotation * point + translation;
                [point / point.z, there / there.z]
            });
            let truth = so3::hat(translation) * rotation;
            let truth = truth * (2.0_f64.sqrt() / truth.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt());
            let found = five_points(&matches);
            let off = |e: &DMat3| {
                let e = *e * (2.0_f64.sqrt() / e.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt());
                let far = |e: DMat3| (e - truth).to_cols_array().iter().fold(0.0, |m: f64, x| m.max(x.abs()));
                far(e).min(far(-e))
            };
            missed += usize::from(!found.iter().any(|e| off(e) < 1e-5));
            for e in &found {
                let scale = e.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
                assert!(matches.iter().all(|[x, y]| y.dot(*e * *x).abs() < 1e-6 * scale));
            }
        }
        assert!(missed <= 3, "{missed} of 300 missed");
    }

    #[test]
    fn the_same_match_five_times_gives_nothing() {
        assert!(five_points(&[[DVec3::Z, DVec3::new(0.1, 0.2, 1.0)]; 5]).is_empty());
    }
}
