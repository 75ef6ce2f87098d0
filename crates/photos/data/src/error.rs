//! Errors in data from outside.

use std::path::{Path, PathBuf};

/// Why a scene could not be loaded or used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read.
    #[error(transparent)]
    Format(#[from] weaver_io::Error),
    /// A file or folder lacks something that a scene needs.
    #[error("{}: {key}: expected {expected}, found {found}", file.display())]
    Unexpected {
        /// The file or folder at fault.
        file: PathBuf,
        /// The entry at fault.
        key: String,
        /// The expected value.
        expected: String,
        /// The value found.
        found: String,
    },
    /// Too many photos cannot be read.
    #[error(
        "photos: {bad} of {all} cannot be read: {reasons}; expected at least {least} that can, at most a quarter that are \
         damaged or missing, and at most half of formats that are not read"
    )]
    Unreadable {
        /// Number that must be readable.
        least: usize,
        /// Number that is not.
        bad: usize,
        /// Number of all.
        all: usize,
        /// Why not, and which these are.
        reasons: String,
    },
    /// A scene has too few views for the request.
    #[error("scene {scene}: {key}: expected {expected}, found {found}")]
    Views {
        /// Name of the scene.
        scene: String,
        /// The kind of views.
        key: &'static str,
        /// The expected value.
        expected: String,
        /// The value found.
        found: usize,
    },
    /// The size of the scene is not determined.
    #[error(
        "scene {scene}: scene_scale: expected a positive length, because the context views {context:?} see no \
         sparse points to measure the scene by; found {found:?}"
    )]
    Scale {
        /// Name of the scene.
        scene: String,
        /// Indices of the context views.
        context: Vec<usize>,
        /// The `scene_scale` option.
        found: Option<f64>,
    },
}

impl Error {
    pub(crate) fn unexpected(
        file: &Path,
        key: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Unexpected { file: file.to_path_buf(), key: key.into(), expected: expected.into(), found: found.into() }
    }
}
