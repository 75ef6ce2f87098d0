//! What can go wrong with a run.

use std::path::PathBuf;
use weaver_blocks::BlockError;
use weaver_fit::FitError;

/// Why a run cannot begin or go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The optimization refused, or its numbers grew beyond all bounds.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] weaver_io::Error),
    /// The folder holds a run already, or a file of it could not be read or written.
    #[error(transparent)]
    Run(#[from] weaver_run::Error),
    /// The capture could not be read.
    #[error(transparent)]
    Capture(#[from] weaver_data::Error),
    /// The capture cannot be cut into blocks.
    #[error("{}: {source}", capture.display())]
    Blocks {
        /// The capture.
        capture: PathBuf,
        /// The reason.
        source: BlockError,
    },
    /// The page of the scene cannot be made.
    #[error(transparent)]
    View(#[from] weaver_view::ViewError),
    /// The rasterizer refused.
    #[error(transparent)]
    Raster(#[from] weaver_splat::RasterError),
    /// The capture gives nothing to fit.
    #[error("{}: {key}: expected {expected}, found {found}", capture.display())]
    Photos {
        /// The capture.
        capture: PathBuf,
        /// The missing key.
        key: &'static str,
        /// The expected value.
        expected: String,
        /// The value found.
        found: String,
    },
    /// The capture is no longer what the run began with.
    #[error("{}: {key}: expected {expected}, found {found}", capture.display())]
    Changed {
        /// The capture.
        capture: PathBuf,
        /// The changed item.
        key: String,
        /// The expected value.
        expected: String,
        /// The value found.
        found: String,
    },
}
