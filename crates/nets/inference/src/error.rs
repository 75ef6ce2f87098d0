//! Errors between photos and a scene.

use std::path::PathBuf;
use weaver_io::Advice;
use weaver_router::AllocationKind;

/// Why a prediction could not be made or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Photos, cameras or options that do not fit together.
    #[error("{0}")]
    Input(String),
    /// A budget was given to an allocation that takes none.
    #[error("budget {budget}: the allocation `{allocation}` has no budget; dithered, grid and random have one")]
    NoBudget {
        /// The allocation.
        allocation: AllocationKind,
        /// The budget that was given.
        budget: f64,
        /// The remedy, [`Advice::Setting`].
        source: Advice,
    },
    /// An image size that is not made of whole patches.
    #[error("image size: expected multiples of {patch}, found {side}")]
    ImageSize {
        /// Side of a patch, pixels.
        patch: usize,
        /// The side that does not fit, pixels.
        side: usize,
        /// The remedy, [`Advice::Setting`].
        source: Advice,
    },
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] weaver_io::Error),
    /// Photos or cameras could not be read.
    #[error(transparent)]
    Data(#[from] weaver_data::Error),
    /// A prediction could not be refined.
    #[error(transparent)]
    Fit(#[from] weaver_fit::FitError),
    /// A checkpoint is damaged or belongs to another model.
    #[error("{}: {message}", path.display())]
    Checkpoint {
        /// The checkpoint.
        path: PathBuf,
        /// The key, the expected and the found value.
        message: String,
    },
    /// The network's output holds NaN or infinity.
    #[error("{what} is not finite everywhere; the weights may not belong to this network")]
    Numeric {
        /// Name of the output.
        what: String,
    },
    /// The free memory does not suffice.
    #[error("this needs about {:.1} GB of memory and {:.1} GB is free", *needed as f64 / 1e9, *available as f64 / 1e9)]
    Memory {
        /// Bytes needed.
        needed: u64,
        /// Bytes free.
        available: u64,
        /// The remedy, [`Advice::LessMemory`] or [`Advice::SmallerNetwork`].
        source: Advice,
    },
    /// The Gaussians could not be drawn.
    #[error(transparent)]
    Render(#[from] weaver_splat::RasterError),
}

impl From<weaver_router::AllocationError> for Error {
    fn from(error: weaver_router::AllocationError) -> Self {
        Self::Input(error.to_string())
    }
}
