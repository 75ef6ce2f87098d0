//! What can go wrong with a run.

use std::path::PathBuf;

/// Why a run cannot begin or go on.
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
    /// Something is not as it was, or as it has to be.
    #[error("{}: {what}: expected {expected}, found {found}", path.display())]
    Invalid {
        /// The file or folder.
        path: PathBuf,
        /// The part of it.
        what: &'static str,
        /// The content that was expected.
        expected: String,
        /// The content that was found.
        found: String,
    },
}

impl LidarRunError {
    /// True if the map could not be drawn, which is not a scan's fault.
    pub(crate) fn is_of_map(&self) -> bool {
        matches!(self, Self::Lidar(crate::Error::Raster(_)))
    }
}
