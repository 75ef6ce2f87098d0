//! What can go wrong with lists, features and annotations.

use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Result with [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

/// Why features, lists or annotations cannot be used; the message names the file, what was expected and what was found.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file that could not be read or written.
    #[error(transparent)]
    File(#[from] weaver_io::Error),
    /// Content that does not fit.
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
        /// The stage that it was in.
        found: String,
    },
    /// The optimizer's state of a checkpoint is that of other parameters.
    #[error("optimizer: {0}")]
    State(#[from] weaver_nn::StateError),
    /// Whoever looked on ended the training.
    #[error("{stage}: stopped after step {step}")]
    Stopped {
        /// The stage of training.
        stage: String,
        /// Steps of it done.
        step: usize,
    },
}

impl Error {
    /// Content of `path` that is not as it should be.
    pub(crate) fn invalid(path: &Path, place: impl Display, expected: impl Display, found: impl Display) -> Self {
        Self::Invalid {
            path: path.to_path_buf(),
            place: place.to_string(),
            expected: expected.to_string(),
            found: found.to_string(),
        }
    }
}
