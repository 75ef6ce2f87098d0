//! Images as the rest of the workspace sees them.

/// An RGB image, `[height, width, 3]` row-major, sRGB values / 255 in [0, 1], never linearised.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// `height * width * 3` values.
    pub pixels: Vec<f32>,
}
