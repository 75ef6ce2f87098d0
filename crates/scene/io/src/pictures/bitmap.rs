//! Images of 8 bits.

use crate::pictures::image::encode_png;
use crate::{Image, Result, atomic_write};
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use std::path::Path;

/// An RGB image of 8 bits, `[height, width, 3]` row-major, sRGB: a quarter of the memory of an [`Image`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Bitmap {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `height * width * 3` values.
    pub pixels: Vec<u8>,
}

impl Bitmap {
    /// The image with values divided by 255.
    pub fn to_image(&self) -> Image {
        Image::from_bytes(self.width, self.height, &self.pixels)
    }

    /// Writes an 8-bit RGB PNG file, atomically.
    ///
    /// # Errors
    /// When the file cannot be written, or the image has no pixels.
    pub fn write_png(&self, path: impl AsRef<Path>) -> Result<()> {
        atomic_write(path, |w| encode_png(w, self.width, self.height, &self.pixels))
    }

    /// An 8-bit RGB PNG file in memory.
    ///
    /// # Errors
    /// When the image has no pixels.
    pub fn to_png(&self) -> std::io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        encode_png(&mut bytes, self.width, self.height, &self.pixels)?;
        Ok(bytes)
    }

    /// A baseline JPEG file in memory, of a quality from 1 to 100 as libjpeg counts it.
    ///
    /// # Errors
    /// When the image has no pixels, or more than 65535 on a side.
    pub fn to_jpeg(&self, quality: u8) -> std::io::Result<Vec<u8>> {
        let (width, height, mut bytes) = (self.width as u32, self.height as u32, Vec::new());
        let mut encoder = JpegEncoder::new_with_quality(&mut bytes, quality);
        encoder.encode(&self.pixels, width, height, ExtendedColorType::Rgb8).map_err(std::io::Error::other)?;
        Ok(bytes)
    }
}
