//! The content of a file of Gaussians.

use super::blocks::Blocks;
use crate::Result;
use weaver_scene::Gaussians;

/// Gaussians of a file, and how they are to be drawn as far as the file says so.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneFile {
    /// The Gaussians.
    pub gaussians: Gaussians,
    /// Settings of drawing them.
    pub drawing: Drawing,
}

/// A file of Gaussians that can be read in parts; binary PLY, splat and SPZ files are read or unpacked on demand.
pub struct OpenScene<'a> {
    /// The Gaussians.
    pub gaussians: Box<dyn Blocks + 'a>,
    /// Settings of drawing them.
    pub drawing: Drawing,
}

impl OpenScene<'_> {
    /// All that the file holds.
    ///
    /// # Errors
    /// When the file cannot be read, or holds a value that a renderer cannot use.
    pub fn all(self) -> Result<SceneFile> {
        Ok(SceneFile { gaussians: self.gaussians.into_all()?, drawing: self.drawing })
    }
}

impl std::fmt::Debug for OpenScene<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (count, degree) = (self.gaussians.len(), self.gaussians.degree());
        f.debug_struct("OpenScene")
            .field("len", &count)
            .field("degree", &degree)
            .field("drawing", &self.drawing)
            .finish()
    }
}

impl From<SceneFile> for OpenScene<'_> {
    fn from(SceneFile { gaussians, drawing }: SceneFile) -> Self {
        Self { gaussians: Box::new(gaussians), drawing }
    }
}

/// Settings of drawing the Gaussians of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Drawing {
    /// Opacities are lowered where a Gaussian is widened to a pixel, as they were in training; false where a file does
    /// not say so.
    pub antialiased: bool,
}

impl Drawing {
    /// Drawing with or without lowered opacities of widened Gaussians.
    pub fn antialiased(antialiased: bool) -> Self {
        Self { antialiased }
    }
}

impl From<Gaussians> for SceneFile {
    fn from(gaussians: Gaussians) -> Self {
        Self { gaussians, drawing: Drawing::default() }
    }
}
