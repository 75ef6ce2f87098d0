//! Errors of runs.

use std::path::PathBuf;
use weaver_io::Advice;

/// Error of beginning, resuming or showing a run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] weaver_io::Error),
    /// The film could not be read.
    #[error(transparent)]
    Film(#[from] weaver_data::Error),
    /// The rasterizer refused.
    #[error(transparent)]
    Raster(#[from] weaver_splat::RasterError),
    /// A setting is out of range.
    #[error("{key}: expected {expected}, found {found}")]
    Setting {
        /// The setting.
        key: &'static str,
        /// The expected value.
        expected: String,
        /// The value found.
        found: String,
        /// The remedy, [`Advice::Setting`].
        source: Advice,
    },
    /// The folder holds a run already, the run is complete, or a file of it could not be read or written.
    #[error(transparent)]
    Run(#[from] weaver_run::Error),
    /// There is no trained router, and therefore no mixture.
    #[error("{}: expected a complete run, found one in stage {stage}, step {step}; go on with --resume", folder.display())]
    Incomplete {
        /// The folder.
        folder: PathBuf,
        /// The present stage, from 1.
        stage: usize,
        /// The present step of the stage.
        step: usize,
    },
    /// The film has changed since the run began.
    #[error("{film}: photos, cameras and times: expected those that the run in {} began with, found others", folder.display())]
    FilmChanged {
        /// The folder.
        folder: PathBuf,
        /// The film.
        film: String,
    },
    /// A loss is NaN or infinite.
    #[error("{}: the loss is {loss} in stage {stage}, step {step}", folder.display())]
    Diverged {
        /// The folder.
        folder: PathBuf,
        /// The stage, from 1.
        stage: usize,
        /// The step of the stage.
        step: usize,
        /// The loss found.
        loss: f32,
    },
}

impl RunError {
    pub(crate) fn setting(key: &'static str, expected: impl Into<String>, found: impl ToString) -> Self {
        let (expected, found) = (expected.into(), found.to_string());
        Self::Setting { key, expected, found, source: Advice::Setting(key) }
    }
}
