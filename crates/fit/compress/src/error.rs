use thiserror::Error;
use weaver_codec::CodecError;
use weaver_splat::RasterError;

/// Errors of compression.
#[derive(Debug, Error)]
pub enum CompressError {
    /// The scene cannot be encoded.
    #[error(transparent)]
    Codec(#[from] CodecError),
    /// The scene cannot be drawn.
    #[error(transparent)]
    Raster(#[from] RasterError),
    /// There is nothing to judge by.
    #[error("cameras: expected at least one, found none")]
    NoCameras,
    /// The quality is no number of decibels that can be reached.
    #[error("quality: expected decibels above 0 and up to {most}, found {found}")]
    Quality {
        /// The largest number.
        most: f64,
        /// The number found.
        found: f64,
    },
    /// No setting of the codec is as good as wanted.
    #[error("quality: expected {wanted} dB, found {reached:.2} dB at the finest setting")]
    TooFine {
        /// The quality wanted, dB.
        wanted: f64,
        /// The quality reached, dB.
        reached: f64,
    },
}
