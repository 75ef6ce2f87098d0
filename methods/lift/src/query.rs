//! Features compared with prompts.

use crate::error::{LiftError, expect_len};
use crate::passes::for_rows;
use weaver_kernels::Real;

/// The scores `x_j . t_b` of `features` `[P, channels]` for `prompts` `[B, channels]`: `[P, B]`, cosines for features
/// and prompts of length 1.
///
/// Drawn as features of the Gaussians ([`Operator::forward`](crate::Operator::forward)), they are maps that answer the
/// prompts.
///
/// # Errors
/// Lengths that do not fit.
///
/// ```
/// let scores = weaver_lift::scores(&[1.0, 0.0, 0.0, 2.0], &[1.0, 0.0, 0.6, 0.8], 2)?;
/// assert_eq!(scores, [1.0, 0.6, 0.0, 1.6]);
/// # Ok::<(), weaver_lift::LiftError>(())
/// ```
pub fn scores<T: Real>(features: &[T], prompts: &[T], channels: usize) -> Result<Vec<T>, LiftError> {
    if channels == 0 {
        return Err(LiftError::NoChannels);
    }
    let (splats, count) = (features.len() / channels, prompts.len() / channels);
    expect_len("features", features.len(), splats * channels)?;
    expect_len("prompts", prompts.len(), count * channels)?;
    let mut scores = vec![T::ZERO; splats * count];
    if count > 0 {
        for_rows(&mut scores, count, |j, row| {
            let feature = &features[j * channels..][..channels];
            for (score, prompt) in row.iter_mut().zip(prompts.chunks_exact(channels)) {
                *score = feature.iter().zip(prompt).map(|(x, t)| *x * *t).sum();
            }
        });
    }
    Ok(scores)
}
