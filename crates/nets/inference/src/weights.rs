//! Files of weights, of runs or published.

use crate::published::{Network, Opened};
use crate::{Error, SplatWeaverPredictor};
use std::path::Path;
use weaver_io::safetensors::Mapped;
use weaver_router::AllocationKind;

/// True if a file holds the checkpoint of a training run, or small weights made of one.
///
/// # Errors
/// When it cannot be read, or is no file of weights.
pub fn is_of_run(path: &Path) -> Result<bool, Error> {
    Ok(Mapped::open(path)?.metadata().get("format").is_some_and(|format| format.starts_with("splatweaver-checkpoint")))
}

impl SplatWeaverPredictor {
    /// Opens a published checkpoint that makes Gaussians: a safetensors file, an index of several, or the folder.
    ///
    /// # Errors
    /// When it cannot be read, is of another model, or makes no Gaussians.
    pub fn open_published(path: &Path) -> Result<Self, Error> {
        match Opened::new(path, true)?.load(false)? {
            (Network::SplatWeaver(model), params) => {
                Ok(Self::new(*model, params, AllocationKind::Sampled, crate::published::PUBLISHED_BUDGET))
            }
            (Network::Vggt(_), _) => {
                let message = "expected a network that makes Gaussians, found cameras and depth only".into();
                Err(Error::Checkpoint { path: path.to_path_buf(), message })
            }
        }
    }
}
