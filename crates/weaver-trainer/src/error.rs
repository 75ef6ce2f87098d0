//! What can go wrong in a run.

use std::path::PathBuf;

/// Why a run could not start, or stopped.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The configuration is wrong.
    #[error("{place}: {message}")]
    Config {
        /// The file, flag or preset.
        place: String,
        /// The key, what was expected and what was found.
        message: String,
    },
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] weaver_io::Error),
    /// Scenes could not be loaded or used.
    #[error(transparent)]
    Data(#[from] weaver_data::Error),
    /// A checkpoint does not fit the model.
    #[error("{}: {message}", path.display())]
    Checkpoint {
        /// The checkpoint.
        path: PathBuf,
        /// The key, what was expected and what was found.
        message: String,
    },
    /// A loss or a gradient is no longer a number.
    #[error("step {step}: {term} is {value}; training stopped{}", kept(last_good))]
    Diverged {
        /// The step at which it happened.
        step: usize,
        /// The loss term, or `gradient norm`.
        term: String,
        /// What it was.
        value: f32,
        /// The last good checkpoint, if one was written.
        last_good: Option<PathBuf>,
    },
    /// Parameters that a stage should train are not connected to its losses.
    #[error("stage `{stage}`: no gradient reached {} trainable parameters: {}", names.len(), names.join(", "))]
    MissingGradients {
        /// The stage's name.
        stage: String,
        /// The parameters' names.
        names: Vec<String>,
    },
    /// Something was asked for that makes no sense together.
    #[error("{0}")]
    Usage(String),
}

fn kept(path: &Option<PathBuf>) -> String {
    path.as_ref().map_or(String::new(), |p| format!("; the last good checkpoint is {}", p.display()))
}
