//! Errors of lists, features, annotations and training.

use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Result with [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

/// Error of features, lists, annotations or training; the message names the file, the expected and the found content.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file that could not be read or written.
    #[error(transparent)]
    File(#[from] weaver_io::Error),
    /// Invalid content of a file.
    #[error("{}: {place}: expected {expected}, found {found}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// The line, key or video.
        place: String,
        /// The expected value.
        expected: String,
        /// The value found.
        found: String,
    },
    /// The loss is no longer a finite number.
    #[error("{stage}: the loss of step {step} is not finite; a smaller rate may help")]
    Diverged {
        /// The stage of training.
        stage: String,
        /// The step, from 1.
        step: usize,
    },
    /// A checkpoint is of another training.
    #[error("stage: expected one of this training, found {found}")]
    Stage {
        /// The stage of the checkpoint.
        found: String,
    },
    /// The optimizer's state in a checkpoint belongs to other parameters.
    #[error("optimizer: {0}")]
    State(#[from] weaver_nn::StateError),
}

impl Error {
    /// Invalid content of `path`.
    pub(crate) fn invalid(path: &Path, place: impl Display, expected: impl Display, found: impl Display) -> Self {
        Self::Invalid {
            path: path.to_path_buf(),
            place: place.to_string(),
            expected: expected.to_string(),
            found: found.to_string(),
        }
    }
}
