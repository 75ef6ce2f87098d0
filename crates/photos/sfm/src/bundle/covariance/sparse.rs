//! The diagonal of the inverse of the equations of many cameras.

use super::{Inner, dot};
use crate::bundle::descent::{Descent, Limits};
use crate::bundle::lens::NUMBERS;
use crate::bundle::profile::Profile;
use crate::bundle::sparse::Sparse;
use crate::bundle::structure::NONE;
use crate::bundle::sums::{BLOCK, PADDED};
use crate::bundle::system::Row;

/// Lenses up to which conjugate gradients find each one's marginal deviation.
const LENSES: usize = 16;

impl Inner<'_> {
    /// The diagonal of the pseudo-inverse where a factor can be found, else the variances of each camera
    /// [`alone`](Self::alone).
    ///
    /// With G the orthonormal movements that no observation determines, E as many unit vectors, no sum of them in the
    /// complement of G, and `C = (S + w E E^T)^-1`, the pseudo-inverse is `(1 - G G^T) C (1 - G G^T)` for any w: C is
    /// applied to vectors without a part along G, so that the solution is 0 at E, and exact.
    pub(super) fn marginal_of_many(&self, gauge: &[Vec<f64>], limits: &Limits) -> Option<Vec<Row>> {
        let reduced = &self.descent.reduced;
        let Some(mut profile) = Profile::new(reduced, limits.profile) else { return self.alone(limits) };
        profile.load(reduced, |row, k| self.unit(row, k));
        let weight = self.mean();
        held(gauge).into_iter().for_each(|at| profile.hold(at / BLOCK, at % BLOCK, weight));
        if !profile.factor() {
            return None;
        }
        let solved: Vec<Vec<f64>> = gauge.iter().map(|g| by_blocks(&mut profile, g)).collect();
        let mut inverse = profile.inverse_diagonal();
        let both: Vec<Vec<f64>> = gauge.iter().map(|g| solved.iter().map(|s| dot(g, s)).collect()).collect();
        for (row, of) in inverse.iter_mut().enumerate() {
            for (k, of) in of.iter_mut().enumerate().take(BLOCK) {
                let at = BLOCK * row + k;
                for (g, (s, both)) in gauge.iter().zip(solved.iter().zip(&both)) {
                    let twice: f64 = gauge.iter().zip(both).map(|(other, both)| other[at] * both).sum();
                    *of += g[at] * (twice - 2.0 * s[at]);
                }
            }
        }
        Some(inverse)
    }

    /// The diagonals of the inverses of diagonal blocks, but for lenses of the inverse of all.
    fn alone(&self, limits: &Limits) -> Option<Vec<Row>> {
        let Descent { reduced, blocks, system, .. } = self.descent;
        let mut sparse = Sparse::new(reduced, limits.tolerance, limits.iterations);
        let mut inverse = sparse.inverse_diagonals(reduced)?;
        for (row, of) in inverse.iter_mut().enumerate() {
            (0..BLOCK).for_each(|k| of[k] /= self.unit(row, k).powi(2));
        }
        let lenses: Vec<usize> = blocks.of_lens.iter().filter(|b| **b != NONE).map(|b| *b as usize).collect();
        if lenses.len() <= LENSES {
            let mut step = vec![[0.0; PADDED]; reduced.rows];
            for lens in lenses {
                for k in (0..NUMBERS).filter(|k| system.matrix[lens].0[*k][*k] > 0.0) {
                    let mut right = vec![[0.0; PADDED]; reduced.rows];
                    right[lens][k] = 1.0;
                    if !sparse.solve_for(reduced, &right, &mut step) {
                        return None;
                    }
                    inverse[lens][k] = step[lens][k];
                }
            }
        }
        Some(inverse)
    }
}

/// The solution of a profile's equations.
fn by_blocks(profile: &mut Profile, right: &[f64]) -> Vec<f64> {
    let padded = |x: &[f64]| std::array::from_fn(|k| x.get(k).copied().unwrap_or(0.0));
    let right: Vec<Row> = right.chunks_exact(BLOCK).map(padded).collect();
    let mut solved = vec![[0.0; PADDED]; right.len()];
    profile.substitute(&right, &mut solved);
    solved.iter().flat_map(|row| row[..BLOCK].to_vec()).collect()
}

/// Numbers to hold, one for each movement, so that no sum of the movements leaves them all unchanged: each is the
/// number that the remaining movements, the others held, change most.
fn held(gauge: &[Vec<f64>]) -> Vec<usize> {
    let mut left = gauge.to_vec();
    let mut held = Vec::new();
    for _ in gauge {
        let most = |at: usize| left.iter().map(|g| g[at] * g[at]).sum::<f64>();
        let Some(at) = (0..left[0].len()).max_by(|a, b| most(*a).total_cmp(&most(*b))) else { break };
        let direction: Vec<f64> = left.iter().map(|g| g[at]).collect();
        let length = dot(&direction, &direction);
        for other in 0..left[0].len() {
            let along = left.iter().zip(&direction).map(|(g, d)| g[other] * d).sum::<f64>() / length;
            left.iter_mut().zip(&direction).for_each(|(g, d)| g[other] -= along * d);
        }
        held.push(at);
    }
    held
}
