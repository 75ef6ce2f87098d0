//! Errors of runs.

use std::path::PathBuf;
use weaver_io::Advice;

/// Why a run of any kind cannot begin or go on.
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
        /// The remedy, [`Advice::Resume`].
        source: Advice,
    },
    /// A file with the mark of a unit of work has something else.
    #[error("{}: expected a unit of work, found something else", mark.display())]
    Unit {
        /// The file.
        mark: PathBuf,
    },
    /// The run has nothing left to do.
    #[error("{}: the run is complete", folder.display())]
    Complete {
        /// The folder.
        folder: PathBuf,
        /// There is no remedy, [`Advice::Complete`].
        source: Advice,
    },
}

impl Error {
    /// Refusal to begin a run in a folder that has one.
    pub fn run_exists(folder: impl Into<PathBuf>) -> Self {
        Self::RunExists { folder: folder.into(), source: Advice::Resume }
    }

    /// Refusal to go on with a run that is complete.
    pub fn complete(folder: impl Into<PathBuf>) -> Self {
        Self::Complete { folder: folder.into(), source: Advice::Complete }
    }
}
