//! The file of lifted features.

use crate::Failure;
use std::path::Path;
use weaver_io::safetensors::{TensorData, Tensors};

/// Lifted features of the Gaussians of a scene, with a record of how they were lifted.
#[derive(Clone, Debug)]
pub struct LiftedFile {
    tensors: Tensors,
    /// Numbers of a feature.
    pub channels: usize,
}

impl LiftedFile {
    /// Reads the features of a scene of `gaussians` Gaussians, as `splatweaver lift` writes them.
    ///
    /// # Errors
    /// When the file cannot be read, or has features of another number of Gaussians.
    pub fn read(path: &Path, scene: &Path, gaussians: usize) -> Result<Self, Failure> {
        let tensors = Tensors::read(path)?;
        let tensor = tensors.get("features")?;
        let (TensorData::F32(_), &[rows, channels @ 1..=usize::MAX]) = (&tensor.data, &tensor.shape[..]) else {
            let found = format!("{} {:?}", tensor.data.dtype(), tensor.shape);
            return Err(refused(path, "features of type F32 [Gaussians, channels]", &found));
        };
        if rows != gaussians {
            let expected = format!("features of {gaussians} Gaussians, as {} has", scene.display());
            return Err(refused(path, &expected, &rows.to_string()));
        }
        Ok(Self { tensors, channels })
    }

    /// The features, `[Gaussians, channels]`.
    pub fn features(&self) -> &[f32] {
        match self.tensors.get("features").map(|tensor| &tensor.data) {
            Ok(TensorData::F32(features)) => features,
            _ => unreachable!("reading has looked at them"),
        }
    }

    /// An entry of the record of how the features were lifted.
    pub fn said(&self, name: &str) -> Option<&String> {
        self.tensors.metadata.get(name)
    }
}

fn refused(path: &Path, expected: &str, found: &str) -> Failure {
    Failure::message(format!("{}: expected {expected}, found {found}", path.display()))
}
