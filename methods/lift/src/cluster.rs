//! Clusters of Gaussians by their features.

use crate::error::{LiftError, expect_len};
use crate::hdbscan::{HdbscanOptions, hdbscan};
use crate::pca::Pca;
use weaver_kernels::Real;

/// Options of clustering Gaussians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClusterOptions {
    /// Number of principal components of the features, or all if there are fewer.
    pub components: usize,
    /// Definition of a cluster.
    pub hdbscan: HdbscanOptions,
}

impl Default for ClusterOptions {
    /// As published: 50 components, 500 Gaussians, 10 neighbors.
    fn default() -> Self {
        Self { components: 50, hdbscan: HdbscanOptions::default() }
    }
}

/// The clusters of Gaussians by their `features` `[P, channels]`: [`Pca`], then [`hdbscan`]. `None` is noise, or an
/// unseen Gaussian (`seen` `[P]` is 0), which is excluded from clustering.
///
/// # Errors
/// Lengths that do not fit.
pub fn cluster<T: Real>(
    features: &[T],
    channels: usize,
    seen: &[T],
    options: &ClusterOptions,
) -> Result<Vec<Option<u32>>, LiftError> {
    expect_len("features", features.len(), seen.len() * channels)?;
    let of_seen: Vec<usize> = (0..seen.len()).filter(|j| seen[*j] > T::ZERO).collect();
    let points: Vec<T> = of_seen.iter().flat_map(|j| &features[j * channels..(j + 1) * channels]).copied().collect();
    let mut pca = Pca::of(&points, channels, options.components);
    pca.drop_rounding();
    let found = hdbscan(&pca.project(&points), pca.components(), &options.hdbscan);
    let mut labels = vec![None; seen.len()];
    of_seen.iter().zip(found).for_each(|(j, label)| labels[*j] = label);
    Ok(labels)
}
