//! What can be wrong with features and scenes.

use weaver_splat::RasterError;

/// Why features could not be lifted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LiftError {
    /// A length that does not fit.
    #[error("{what}: expected {expected} numbers, found {found}")]
    Length {
        /// The array that has that length.
        what: &'static str,
        /// Expected number of numbers.
        expected: usize,
        /// Number of numbers found.
        found: usize,
    },
    /// Features without a channel.
    #[error("features: expected at least one channel, found none")]
    NoChannels,
    /// The mask leaves nothing of any view, or all pixels hold NaN.
    #[error("features: expected pixels that count, found all {rays} masked")]
    AllMasked {
        /// Pixels of all views.
        rays: usize,
    },
    /// Cameras that look elsewhere.
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
