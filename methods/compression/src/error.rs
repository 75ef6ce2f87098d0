use thiserror::Error;
use weaver_codec::CodecError;
use weaver_compress::CompressError;
use weaver_splat::RasterError;

/// Errors of the methods.
#[derive(Debug, Error)]
pub enum CompressionError {
    /// The scene cannot be judged, or not compressed to a quality.
    #[error(transparent)]
    Compress(#[from] CompressError),
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
    /// Bytes that are not the method's.
    #[error("{place}: expected {expected}, found {found}")]
    Stream {
        /// The part.
        place: String,
        /// The expected content.
        expected: String,
        /// The content found.
        found: String,
    },
}
