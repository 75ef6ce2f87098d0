//! Failures of a rasterizer.

use std::fmt;

/// Failure of a rasterizer, with an explanation.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RasterError {
    /// Arguments that do not fit together, or do not fit the last drawing.
    Arguments(String),
    /// More than the rasterizer can draw in one call.
    TooMany(String),
    /// Arguments that fit together, but of a kind that this rasterizer does not draw.
    Unsupported(String),
    /// A device that failed.
    Device(String),
}

impl fmt::Display for RasterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Arguments(message) | Self::TooMany(message) | Self::Unsupported(message) | Self::Device(message)) =
            self;
        write!(f, "rasterize: {message}")
    }
}

impl std::error::Error for RasterError {}
