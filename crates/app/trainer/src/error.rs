//! Errors of training runs.

use std::path::PathBuf;

/// Why a run could not start, or stopped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The configuration is wrong.
    #[error(transparent)]
    Config(#[from] weaver_run::settings::Error),
    /// Options that do not fit together.
    #[error("{0}")]
    Input(String),
    /// The folder holds a run already, or a file of it could not be read or written.
    #[error(transparent)]
    Run(#[from] weaver_run::Error),
    /// A prediction could not be made.
    #[error(transparent)]
    Inference(#[from] weaver_inference::Error),
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
        /// The key, the expected value and the value found.
        message: String,
    },
    /// A loss or a gradient is no longer a number.
    #[error("step {step}: {term} is {value}; training stopped{}", kept(last_good))]
    Numeric {
        /// The step at which it happened.
        step: usize,
        /// The loss term, or `gradient norm`.
        term: String,
        /// The value found.
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
}

fn kept(path: &Option<PathBuf>) -> String {
    path.as_ref().map_or(String::new(), |p| format!("; the last good checkpoint is {}", p.display()))
}
