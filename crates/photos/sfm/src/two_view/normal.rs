//! Least squares in a few unknowns.

use weaver_kernels::dense::{cholesky, cholesky_solve};

/// The normal equations H s = -g of weighted least squares in N unknowns.
pub(super) struct Normal<const N: usize> {
    h: [[f64; N]; N],
    g: [f64; N],
}

impl<const N: usize> Default for Normal<N> {
    fn default() -> Self {
        Self { h: [[0.0; N]; N], g: [0.0; N] }
    }
}

impl<const N: usize> Normal<N> {
    /// Adds a residual with its derivatives.
    pub(super) fn add(&mut self, weight: f64, residual: f64, row: &[f64; N]) {
        // Infinite residuals have no weight, and 0 times infinity is not 0.
        if weight > 0.0 {
            for i in 0..N {
                self.g[i] += weight * row[i] * residual;
                for j in 0..=i {
                    self.h[i][j] += weight * row[i] * row[j];
                }
            }
        }
    }

    /// The step, damped by 1e-3 of the mean curvature and at most 0.3 long; `None` if nothing has weight.
    pub(super) fn step(mut self) -> Option<[f64; N]> {
        let damping = 1e-3 * (0..N).map(|i| self.h[i][i]).sum::<f64>() / N as f64;
        (0..N).for_each(|i| self.h[i][i] += damping);
        if !cholesky(self.h.as_flattened_mut(), N, N) {
            return None;
        }
        let mut s = self.g.map(|g| -g);
        cholesky_solve(self.h.as_flattened(), &mut s);
        let length = s.iter().map(|s| s * s).sum::<f64>().sqrt();
        length.is_finite().then(|| s.map(|s| s * (0.3 / length).min(1.0)))
    }
}
