//! Least squares in a few unknowns.

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
        // Cholesky's factor, in place; forward and back substitution.
        for i in 0..N {
            self.h[i][i] += damping;
            for j in 0..=i {
                let sum = self.h[i][j] - (0..j).map(|k| self.h[i][k] * self.h[j][k]).sum::<f64>();
                self.h[i][j] = if i > j { sum / self.h[j][j] } else { sum.sqrt() };
            }
        }
        let mut s = self.g.map(|g| -g);
        for i in 0..N {
            s[i] = (s[i] - (0..i).map(|k| self.h[i][k] * s[k]).sum::<f64>()) / self.h[i][i];
        }
        for i in (0..N).rev() {
            s[i] = (s[i] - (i + 1..N).map(|k| self.h[k][i] * s[k]).sum::<f64>()) / self.h[i][i];
        }
        let length = s.iter().map(|s| s * s).sum::<f64>().sqrt();
        length.is_finite().then(|| s.map(|s| s * (0.3 / length).min(1.0)))
    }
}
