//! Errors on the way from photos to a scene.

use crate::partition::BlockError;
use std::path::PathBuf;
use weaver_data::some_of;
use weaver_fit::FitError;
use weaver_fit::align::AlignError;
use weaver_io::{Advice, TooLittleMemory};
use weaver_splat::RasterError;

/// Why there are no cameras, or a run cannot begin or go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The optimization refused, or its numbers grew beyond all bounds.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] weaver_io::Error),
    /// The folder holds a run already, or a file of it could not be read or written.
    #[error(transparent)]
    Run(#[from] weaver_run::Error),
    /// The capture could not be read.
    #[error(transparent)]
    Capture(#[from] weaver_data::Error),
    /// Photos or clips could not be read.
    #[error(transparent)]
    Clip(#[from] weaver_clip::Error),
    /// Cameras could not be estimated; the message says which photos are at fault.
    #[error("cameras: {0}")]
    Cameras(String),
    /// Other cameras of the same photos do not compare.
    #[error("{}: expected cameras in several places, found one", file.display())]
    Compared {
        /// The file of the other cameras.
        file: PathBuf,
    },
    /// A photo could not be aligned with the scene.
    #[error("{}: {source}", photo.display())]
    Align {
        /// The photo.
        photo: PathBuf,
        /// The reason.
        source: AlignError,
    },
    /// A mesh, or its texture, could not be made.
    #[error(transparent)]
    Mesh(#[from] weaver_mesh::MeshError),
    /// Photos of a texture are not where the cameras say.
    #[error(
        "{}: expected the photos of {all} cameras for a texture, found none of {}", file.display(), some_of(missing)
    )]
    MissingPhotos {
        /// The file of the cameras.
        file: PathBuf,
        /// Names of the photos.
        missing: Vec<String>,
        /// Number of the cameras.
        all: usize,
    },
    /// There is nothing to compare.
    #[error("{}: expected {expected}, found none", path.display())]
    Nothing {
        /// The scene or the capture.
        path: PathBuf,
        /// The expected content.
        expected: &'static str,
    },
    /// The rasterizer refused a finished scene.
    #[error("{}: {source}", scene.display())]
    Drawing {
        /// The scene.
        scene: PathBuf,
        /// The reason.
        source: RasterError,
    },
    /// There is not enough memory.
    #[error("{0}")]
    Memory(#[source] TooLittleMemory),
    /// The folder of the results has a scene, or a fit that did not come to its end.
    #[error("{}: {message}", folder.display())]
    AlreadyThere {
        /// The folder.
        folder: PathBuf,
        /// The state of the fit in it, and how to go on.
        message: String,
        /// There is nothing to do here.
        source: Advice,
    },
    /// The Gaussians to begin with could not be made.
    #[error(transparent)]
    Given(Box<dyn std::error::Error + Send + Sync>),
    /// The live page could not be served.
    #[error(transparent)]
    Page(#[from] weaver_view_run::Error),
    /// The capture cannot be cut into blocks.
    #[error("{}: {source}", capture.display())]
    Blocks {
        /// The capture.
        capture: PathBuf,
        /// The reason.
        source: BlockError,
    },
    /// The page of the scene cannot be made.
    #[error(transparent)]
    View(#[from] weaver_view::ViewError),
    /// The rasterizer refused.
    #[error(transparent)]
    Raster(#[from] RasterError),
    /// The capture gives nothing to fit.
    #[error("{}: {key}: expected {expected}, found {found}", capture.display())]
    Photos {
        /// The capture.
        capture: PathBuf,
        /// The missing key.
        key: &'static str,
        /// The expected value.
        expected: String,
        /// The value found.
        found: String,
    },
    /// The capture differs from the start of the run.
    #[error("{}: {key}: expected {expected}, found {found}", capture.display())]
    Changed {
        /// The capture.
        capture: PathBuf,
        /// The changed item.
        key: String,
        /// The expected value.
        expected: String,
        /// The value found.
        found: String,
    },
}

impl From<TooLittleMemory> for Error {
    fn from(error: TooLittleMemory) -> Self {
        Self::Memory(error)
    }
}
