//! Failures of making a page.

use weaver_splat::RasterError;

/// Failure of making or serving a page.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ViewError {
    /// A scene or picture that cannot be encoded.
    #[error(transparent)]
    Io(#[from] weaver_io::Error),
    /// A picture that cannot be drawn.
    #[error(transparent)]
    Raster(#[from] RasterError),
    /// A stream of bytes that cannot be written.
    #[error("writing the scene: {0}")]
    Write(#[from] std::io::Error),
}
