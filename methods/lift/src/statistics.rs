//! Statistics of scene and views from lifting.

/// Coverage of the valid pixels by Gaussians.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coverage {
    /// Pixels of all views.
    pub rays: usize,
    /// Pixels that are masked, or have features that are not finite.
    pub masked: usize,
    /// Further pixels with too small an alpha.
    pub dropped: usize,
    /// Gaussians without a valid pixel; their features are zeros.
    pub unseen: usize,
    /// sum r_i over the valid pixels; r is the row sum of A, the alpha image.
    pub(crate) alpha: f64,
    /// sum r_i^2
    pub(crate) alpha_squared: f64,
    /// sum A_ij^2
    pub(crate) squares: f64,
}

impl Coverage {
    /// The mean alpha of the valid pixels: 1 without visible background.
    pub fn mean_alpha(&self) -> f64 {
        self.alpha / (self.rays - self.masked - self.dropped).max(1) as f64
    }

    /// The share of `sum_jk G_jk`, G = A^T A, that is off the diagonal: `1 - sum A_ij^2 / sum r_i^2`. 0 if each pixel
    /// sees one Gaussian, and all solvers agree.
    pub fn off_diagonal(&self) -> f64 {
        1.0 - self.squares / self.alpha_squared
    }
}
