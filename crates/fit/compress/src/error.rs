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
    /// The scene cannot be encoded in a format of files, or decoded from it.
    #[error(transparent)]
    Format(#[from] weaver_io::Error),
    /// The scene cannot be trained.
    #[error(transparent)]
    Fit(#[from] weaver_fit::FitError),
    /// The surface of the scene cannot be made.
    #[error(transparent)]
    Mesh(#[from] weaver_mesh::MeshError),
    /// Bytes that do not follow a method's format.
    #[error("{place}: expected {expected}, found {found}")]
    Stream {
        /// The part.
        place: String,
        /// The expected content.
        expected: String,
        /// The content found.
        found: String,
    },
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
