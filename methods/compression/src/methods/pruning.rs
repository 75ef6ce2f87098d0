//! Pruning by the contributions of Gaussians to pictures.

use crate::views::contributions;
use crate::{CompressionError, Task};
use weaver_scene::Gaussians;

/// Rank of the reference volume, as a share from the largest on.
const LARGE: f64 = 0.1;
/// Power of volumes.
const POWER: f32 = 0.1;

/// Significance of LightGaussian, which MesonGS shares: the sum of blending weights over all pixels of all pictures,
/// times the ratio of the volume to the 90 % quantile of volumes, at most 1, to the power of 0.1; `[N]`.
pub(super) fn significance(gaussians: &Gaussians, task: &Task<'_>) -> Result<Vec<f32>, CompressionError> {
    let volumes: Vec<f32> = gaussians.log_scales.iter().map(|s| s.iter().sum::<f32>().exp()).collect();
    let mut sorted = volumes.clone();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let large = sorted.get((LARGE * sorted.len() as f64) as usize).map_or(1.0, |v| v.max(f32::MIN_POSITIVE));
    let weights = contributions(gaussians, &task.pictures)?;
    Ok(weights.iter().zip(volumes).map(|(weight, volume)| weight * (volume / large).min(1.0).powf(POWER)).collect())
}

/// The share of the Gaussians with the largest values, at least one.
pub(super) fn kept(gaussians: &Gaussians, values: &[f32], share: f64) -> Gaussians {
    let count = (share * gaussians.len() as f64).round().max(1.0) as usize;
    gaussians.select(&gaussians.largest(values, count))
}
