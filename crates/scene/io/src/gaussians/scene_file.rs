//! What a file of Gaussians holds.

use weaver_scene::Gaussians;

/// Gaussians of a file, and how they are to be drawn as far as the file says so.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneFile {
    /// The Gaussians.
    pub gaussians: Gaussians,
    /// Settings of drawing them.
    pub drawing: Drawing,
}

/// Settings of drawing the Gaussians of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Drawing {
    /// Opacities are lowered where a Gaussian is widened to a pixel, as they were in training; false where a file does not say so.
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
