//! Formats of files as methods.

use crate::training::Untrained;
use crate::{CompressionError, Method, Task, Training};
use weaver_io::{SceneFormat, read_gaussians_from, write_gaussians_to};
use weaver_scene::Gaussians;

/// A format of scene files, with the constants of all its writers.
#[derive(Clone, Copy, Debug)]
pub struct Format {
    /// The format, of a single file.
    pub format: SceneFormat,
}

impl Method for Format {
    fn begin<'a>(&'a self, task: &'a Task<'a>) -> Result<Box<dyn Training + 'a>, CompressionError> {
        Ok(Box::new(Untrained(|| encoded(self.format, task.gaussians))))
    }

    fn decode(&self, bytes: &[u8]) -> Result<Gaussians, CompressionError> {
        Ok(read_gaussians_from(bytes, self.format)?)
    }
}

fn encoded(format: SceneFormat, gaussians: &Gaussians) -> Result<Vec<u8>, CompressionError> {
    let mut bytes = Vec::new();
    write_gaussians_to(&mut bytes, format, gaussians)?;
    Ok(bytes)
}

/// The bytes of a PLY.
pub(super) fn ply(gaussians: &Gaussians) -> Result<Vec<u8>, CompressionError> {
    encoded(weaver_io::SCENE_FORMATS[0], gaussians)
}

/// The Gaussians of a PLY.
pub(super) fn from_ply(bytes: &[u8]) -> Result<Gaussians, CompressionError> {
    Ok(read_gaussians_from(bytes, weaver_io::SCENE_FORMATS[0])?)
}
