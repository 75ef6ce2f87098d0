//! RGB images: reading, writing, cropping, mosaics.

use crate::{Result, atomic_write};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use std::io::Write;
use std::path::Path;

/// An RGB image, `[height, width, 3]` row-major. Values are sRGB divided by 255, in [0, 1], never linearized.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `height * width * 3` values.
    pub pixels: Vec<f32>,
}

/// The color behind transparent pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Background {
    /// (1, 1, 1), usual for NeRF-synthetic scenes.
    #[default]
    White,
    /// (0, 0, 0).
    Black,
}

impl Background {
    /// Red, green and blue.
    pub(crate) fn rgb(self) -> [f32; 3] {
        match self {
            Self::White => [1.0; 3],
            Self::Black => [0.0; 3],
        }
    }
}

impl Image {
    /// An image of one color.
    pub fn filled(width: usize, height: usize, rgb: [f32; 3]) -> Self {
        Self { width, height, pixels: rgb.repeat(width * height) }
    }

    /// Writes an 8-bit RGB PNG file, atomically.
    pub fn write_png(&self, path: impl AsRef<Path>) -> Result<()> {
        atomic_write(path, |w| self.encode_png(w))
    }

    /// The bytes of an 8-bit RGB PNG file, those that [`write_png`](Self::write_png) writes.
    ///
    /// # Panics
    /// When the image has no pixels, or not `height * width * 3` values.
    pub fn to_png(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.encode_png(&mut bytes).expect("an image with pixels");
        bytes
    }

    fn encode_png(&self, w: &mut dyn Write) -> std::io::Result<()> {
        encode_png(w, self.width, self.height, &self.to_bytes())
    }

    /// The values as 8-bit numbers, clamped and rounded to the nearest.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.pixels.iter().map(|&x| (x * 255.0).round() as u8).collect()
    }

    /// An image from 8-bit values `[height, width, 3]`.
    ///
    /// # Panics
    /// When the length is not `height * width * 3`.
    pub fn from_bytes(width: usize, height: usize, bytes: &[u8]) -> Self {
        assert_eq!(bytes.len(), width * height * 3, "an RGB image of {width}x{height}");
        Self { width, height, pixels: bytes.iter().map(|&b| f32::from(b) / 255.0).collect() }
    }

    /// The part of `width` x `height` pixels whose top-left corner is (`left`, `top`).
    ///
    /// # Panics
    /// When it extends beyond the image.
    pub fn crop(&self, left: usize, top: usize, width: usize, height: usize) -> Self {
        assert!(
            left + width <= self.width && top + height <= self.height,
            "crop {width}x{height} at ({left}, {top}) sticks out of {}x{}",
            self.width,
            self.height
        );
        let mut pixels = Vec::with_capacity(width * height * 3);
        for y in top..top + height {
            let start = (y * self.width + left) * 3;
            pixels.extend_from_slice(&self.pixels[start..start + width * 3]);
        }
        Self { width, height, pixels }
    }

    /// Puts images side by side from left to right, aligned at the top, with black below the shorter ones.
    pub fn mosaic(images: &[&Self]) -> Self {
        let width = images.iter().map(|i| i.width).sum();
        let height = images.iter().map(|i| i.height).max().unwrap_or(0);
        let mut out = Self::filled(width, height, [0.0; 3]);
        let mut left = 0;
        for image in images {
            for (y, row) in image.pixels.chunks_exact(image.width.max(1) * 3).enumerate() {
                let start = (y * width + left) * 3;
                out.pixels[start..start + row.len()].copy_from_slice(row);
            }
            left += image.width;
        }
        out
    }
}

/// Writes `[height, width, 3]` as a PNG file.
pub(crate) fn encode_png(w: &mut dyn Write, width: usize, height: usize, pixels: &[u8]) -> std::io::Result<()> {
    PngEncoder::new(w)
        .write_image(pixels, width as u32, height as u32, ExtendedColorType::Rgb8)
        .map_err(std::io::Error::other)
}
