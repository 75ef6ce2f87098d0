//! What can go wrong with a run.

use std::path::PathBuf;

/// Why a run cannot begin or go on, whatever it does.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] weaver_io::Error),
    /// The folder of a run is in use.
    #[error("{}: a run exists there already", folder.display())]
    RunExists {
        /// The folder.
        folder: PathBuf,
    },
    /// The run has nothing left to do.
    #[error("{}: the run is complete", folder.display())]
    Complete {
        /// The folder.
        folder: PathBuf,
    },
}
