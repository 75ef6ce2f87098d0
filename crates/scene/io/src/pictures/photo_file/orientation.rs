//! Orientation of photos.

use image::metadata::Orientation::{self, *};

/// The size of a photo once it is upright.
pub(crate) fn turned(orientation: Orientation, (width, height): (usize, usize)) -> (usize, usize) {
    match orientation {
        NoTransforms | FlipHorizontal | FlipVertical | Rotate180 => (width, height),
        Rotate90 | Rotate270 | Rotate90FlipH | Rotate270FlipH => (height, width),
    }
}

/// Where the pixel (x, y) of the upright photo is stored, in a file of `width` x `height`.
pub(super) fn stored(
    orientation: Orientation,
    (width, height): (usize, usize),
    (x, y): (usize, usize),
) -> (usize, usize) {
    match orientation {
        NoTransforms => (x, y),
        FlipHorizontal => (width - 1 - x, y),
        FlipVertical => (x, height - 1 - y),
        Rotate180 => (width - 1 - x, height - 1 - y),
        Rotate90 => (y, height - 1 - x),
        Rotate270 => (width - 1 - y, x),
        Rotate90FlipH => (y, x),
        Rotate270FlipH => (width - 1 - y, height - 1 - x),
    }
}

/// Distance from the border of the decoded picture to the upright photo, at the left and at the top, where the picture
/// reaches so far beyond the stored pixels at its right and its bottom.
pub(super) fn margin(orientation: Orientation, [right, bottom]: [f64; 2]) -> [f64; 2] {
    match orientation {
        NoTransforms | Rotate90FlipH => [0.0, 0.0],
        FlipHorizontal => [right, 0.0],
        FlipVertical => [0.0, bottom],
        Rotate180 => [right, bottom],
        Rotate90 => [bottom, 0.0],
        Rotate270 => [0.0, right],
        Rotate270FlipH => [bottom, right],
    }
}
