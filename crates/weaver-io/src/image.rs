//! RGB images: reading, writing, cropping, mosaics.

use crate::file::read_bytes;
use crate::{Error, Result, atomic_write};
use image::codecs::png::PngEncoder;
use image::{DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageReader};
use std::io::{Cursor, Write};
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

impl Image {
    /// An image of one color.
    pub fn filled(width: usize, height: usize, rgb: [f32; 3]) -> Self {
        Self { width, height, pixels: rgb.repeat(width * height) }
    }

    /// Reads a PNG or JPEG file (8 or 16 bits, gray or RGB, with or without alpha).
    ///
    /// Straight alpha is composited over `background` in sRGB values. The EXIF orientation is *not* applied: cameras
    /// from structure from motion refer to the pixels as stored.
    pub fn read(path: impl AsRef<Path>, background: Background) -> Result<Self> {
        Ok(Self::from_decoded(decode(path.as_ref())?, background))
    }

    /// Reads a file as [`read`](Self::read) does over [`Background::Black`], and its alpha `[height, width]` if it has one:
    /// colors are multiplied by alpha, so that `color + (1 - alpha) background` is the photo over any background.
    pub fn read_with_alpha(path: impl AsRef<Path>) -> Result<(Self, Option<Vec<f32>>)> {
        let decoded = decode(path.as_ref())?;
        let alpha = decoded.color().has_alpha().then(|| decoded.to_rgba32f().pixels().map(|p| p.0[3]).collect());
        Ok((Self::from_decoded(decoded, Background::Black), alpha))
    }

    fn from_decoded(decoded: DynamicImage, background: Background) -> Self {
        let (width, height) = (decoded.width() as usize, decoded.height() as usize);
        let behind = match background {
            Background::White => 1.0,
            Background::Black => 0.0,
        };
        let pixels = if decoded.color().has_alpha() {
            let rgba = decoded.into_rgba32f();
            rgba.pixels().flat_map(|p| [0, 1, 2].map(|c| p.0[c] * p.0[3] + behind * (1.0 - p.0[3]))).collect()
        } else {
            decoded.into_rgb32f().into_raw()
        };
        Self { width, height, pixels }
    }

    /// Width and height of a PNG or JPEG file, from its header alone.
    pub fn dimensions(path: impl AsRef<Path>) -> Result<(usize, usize)> {
        let path = path.as_ref();
        let (width, height) = ImageReader::open(path)
            .and_then(ImageReader::with_guessed_format)
            .map_err(Error::io(path))?
            .into_dimensions()
            .map_err(|e| Error::invalid(path, "header", "a PNG or JPEG image", e))?;
        Ok((width as usize, height as usize))
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
        PngEncoder::new(w)
            .write_image(&self.to_bytes(), self.width as u32, self.height as u32, ExtendedColorType::Rgb8)
            .map_err(std::io::Error::other)
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

fn decode(path: &Path) -> Result<DynamicImage> {
    let bytes = read_bytes(path)?;
    if is_cut_jpeg(&bytes) {
        return Err(Error::invalid(path, "image", "a whole JPEG image", "one that was cut short"));
    }
    let reader = || ImageReader::new(Cursor::new(&bytes)).with_guessed_format().map_err(Error::io(path));
    let wrong = |e| Error::invalid(path, "image", "a PNG or JPEG image", e);
    // Memory is taken for what the header says, which may be anything in a spoilt file.
    let decoder = reader()?.into_decoder().map_err(wrong)?;
    let ((width, height), size) = (decoder.dimensions(), decoder.total_bytes());
    if size / MOST_DENSE > bytes.len() as u64 {
        let found = format!("{} bytes", bytes.len());
        return Err(Error::invalid(path, "image", format!("{width} x {height} pixels, as its header says"), found));
    }
    drop(decoder);
    reader()?.decode().map_err(wrong)
}

/// Bytes of pixels that one byte of a file stands for at most: 1032 by deflate, some hundreds by JPEG.
const MOST_DENSE: u64 = 1100;

/// Whether these are the bytes of a JPEG whose picture has a beginning and no end. Decoders fill the rest with gray.
fn is_cut_jpeg(bytes: &[u8]) -> bool {
    const START: [u8; 2] = [0xff, 0xd8];
    const SCAN: u8 = 0xda;
    const END: [u8; 2] = [0xff, 0xd9];
    if !bytes.starts_with(&START) {
        return false;
    }
    // Segments up to the first scan have a length; one of them may hold a smaller picture with an end of its own.
    let mut at = 2;
    while let Some([0xff, kind, high, low]) = bytes.get(at..at + 4) {
        if *kind == SCAN {
            return !bytes[at..].windows(2).any(|pair| pair == END);
        }
        at += 2 + usize::from(u16::from_be_bytes([*high, *low]));
    }
    // No scan: for the decoder to say.
    false
}
