//! Errors of features and scenes.

use weaver_splat::RasterError;

/// Error of lifting.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LiftError {
    /// A length that does not fit.
    #[error("{what}: expected {expected} numbers, found {found}")]
    Length {
        /// Name of the array.
        what: &'static str,
        /// Expected number of numbers.
        expected: usize,
        /// Number of numbers found.
        found: usize,
    },
    /// Features without a channel.
    #[error("features: expected at least one channel, found none")]
    NoChannels,
    /// No valid pixel in any view: all are masked, or hold NaN.
    #[error("features: expected pixels that count, found all {rays} masked")]
    AllMasked {
        /// Pixels of all views.
        rays: usize,
    },
    /// No Gaussian in any view.
    #[error("cameras: expected views that see some of the {splats} Gaussians, found none that do")]
    NothingSeen {
        /// Gaussians of the scene.
        splats: usize,
    },
    /// A setting out of its range.
    #[error("{key}: expected {expected}, found {found}")]
    Setting {
        /// The setting.
        key: &'static str,
        /// Its range.
        expected: &'static str,
        /// The value found.
        found: f64,
    },
    /// The rasterizer refused.
    #[error(transparent)]
    Raster(#[from] RasterError),
    /// Features could not be read.
    #[error(transparent)]
    Source(Box<dyn std::error::Error + Send + Sync>),
}

/// `found == expected`, or an error about `what`.
pub(crate) fn expect_len(what: &'static str, found: usize, expected: usize) -> Result<(), LiftError> {
    if found == expected { Ok(()) } else { Err(LiftError::Length { what, expected, found }) }
}
