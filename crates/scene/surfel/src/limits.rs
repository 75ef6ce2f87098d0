//! Limits on the surfels that are drawn.

/// Distances between which surfels are drawn, and the largest alpha.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Centers at this distance or nearer are left out, in meters.
    pub near: f64,
    /// Centers farther away are left out, in meters.
    pub far: f64,
    /// Largest alpha of one surfel at one pixel.
    pub alpha_max: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { near: 0.1, far: 120.0, alpha_max: 0.99 }
    }
}
