//! The pixels of a file, all of them or fewer.

use image::DynamicImage;

/// Contents of a file, of 8 bits.
pub(crate) struct Pixels {
    /// Width and height of the file.
    pub whole: (usize, usize),
    /// Factor by which its pixels became one, each way.
    pub shrink: usize,
    /// Width and height after that, rounded up.
    pub size: (usize, usize),
    /// `[height, width, channels]`.
    pub values: Vec<u8>,
    /// 3, or 4 with alpha.
    pub channels: usize,
}

impl Pixels {
    /// True if a pixel is not opaque.
    pub fn is_transparent(&self) -> bool {
        self.channels == 4 && self.values.as_chunks::<4>().0.iter().any(|pixel| pixel[3] < 255)
    }
}

/// The values of a picture of 8 bits, of 3 channels or 4 with alpha. Values that have the form already are not copied.
pub(super) fn values8(picture: DynamicImage) -> Vec<u8> {
    if picture.color().has_alpha() { picture.into_rgba8().into_raw() } else { picture.into_rgb8().into_raw() }
}
