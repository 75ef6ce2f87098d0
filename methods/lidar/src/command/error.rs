//! Errors of runs.

use std::path::PathBuf;

/// Error of beginning or resuming a run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LidarRunError {
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] weaver_io::Error),
    /// The folder holds a run already, or a file of it could not be read or written.
    #[error(transparent)]
    Run(#[from] weaver_run::Error),
    /// Scans or settings cannot be used.
    #[error(transparent)]
    Lidar(#[from] crate::Error),
    /// Content of a file or folder that has changed or is invalid.
    #[error("{}: {what}: expected {expected}, found {found}", path.display())]
    Invalid {
        /// The file or folder.
        path: PathBuf,
        /// The part of it.
        what: &'static str,
        /// The expected content.
        expected: String,
        /// The content found.
        found: String,
    },
}

impl LidarRunError {
    /// True if the map could not be drawn, in contrast to a bad scan.
    pub(crate) fn is_of_map(&self) -> bool {
        matches!(self, Self::Lidar(crate::Error::Raster(_)))
    }
}
