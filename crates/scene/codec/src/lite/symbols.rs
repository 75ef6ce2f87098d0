//! Symbols of Gaussians.

use super::head::UNIT;
use crate::exact::ln;

/// Symbols of a scene, Gaussians in Morton order.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Symbols {
    /// Morton codes of voxels, ascending.
    pub(super) voxels: Vec<u64>,
    /// Log scales, descending.
    pub(super) scales: Vec<[i32; 3]>,
    pub(super) opacities: Vec<i32>,
    pub(super) rotations: Vec<[i32; 3]>,
    /// Coefficients of the transform: of three mixtures of red, green and blue.
    pub(super) colors: Vec<[i32; 3]>,
    /// The same of further harmonics, `[N, K - 1]`.
    pub(super) harmonics: Vec<[i32; 3]>,
}

impl Symbols {
    /// Symbols of zero for Gaussians at these voxels.
    pub(super) fn at(voxels: Vec<u64>, rest: usize) -> Self {
        let count = voxels.len();
        Self {
            voxels,
            scales: vec![[0; 3]; count],
            opacities: vec![0; count],
            rotations: vec![[0; 3]; count],
            colors: vec![[0; 3]; count],
            harmonics: vec![[0; 3]; count * rest],
        }
    }

    /// Symbols of some of the Gaussians, by ascending index; without colors.
    pub(super) fn select(&self, indices: &[usize]) -> Self {
        Self {
            voxels: indices.iter().map(|&i| self.voxels[i]).collect(),
            scales: indices.iter().map(|&i| self.scales[i]).collect(),
            opacities: indices.iter().map(|&i| self.opacities[i]).collect(),
            rotations: indices.iter().map(|&i| self.rotations[i]).collect(),
            ..Self::default()
        }
    }
}

/// Logarithms of the opacities of all symbols, in parts of 2^16.
pub(super) fn ln_opacities(levels: u32) -> Vec<i64> {
    (0..=levels).map(|symbol| (ln(opacity(symbol as i32, levels)) * UNIT).floor() as i64).collect()
}

/// The opacity of a symbol: those at the ends are a quarter of a step from 0 and 1, so that logits are finite.
pub(super) fn opacity(symbol: i32, levels: u32) -> f64 {
    let quarter = 0.25 / f64::from(levels);
    (f64::from(symbol) / f64::from(levels)).clamp(quarter, 1.0 - quarter)
}
