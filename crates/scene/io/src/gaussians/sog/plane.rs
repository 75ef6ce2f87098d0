//! Pictures whose pixels are numbers: lossless WebP.

use crate::{Error, Result};
use image_webp::{ColorType, EncoderParams, WebPDecoder, WebPEncoder};
use std::io::{self, Cursor};
use std::path::Path;

/// Pixels of four bytes, row by row.
pub(super) struct Plane {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<[u8; 4]>,
}

/// Expected number of pixels of a picture.
pub(super) enum Size {
    /// A pixel for each Gaussian, in a picture that is not mostly empty.
    Holds(usize),
    /// So many columns, and rows for so many pixels.
    Columns(usize, usize),
}

/// Pixels that a picture may have beyond twice the required number.
const MORE: usize = 1 << 14;

impl Plane {
    /// The smallest picture, nearly square, for `count` pixels; width and height are multiples of four.
    pub(super) fn for_pixels(count: usize) -> Self {
        let width = ((count as f64).sqrt().ceil() as usize).next_multiple_of(4).max(4);
        Self::new(width, count.div_ceil(width).next_multiple_of(4).max(4))
    }

    pub(super) fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![[0, 0, 0, 255]; width * height] }
    }

    /// Decodes a picture of this size.
    pub(super) fn read(path: &Path, name: &str, data: &[u8], size: Size) -> Result<Self> {
        let invalid = |e| Error::invalid(path, name, "lossless WebP", e);
        let mut decoder = WebPDecoder::new(Cursor::new(data)).map_err(invalid)?;
        if decoder.is_lossy() || decoder.is_animated() {
            return Err(Error::invalid(path, name, "lossless WebP", "a lossy or moving picture"));
        }
        let (width, height) = decoder.dimensions();
        let (width, height) = (width as usize, height as usize);
        let (expected, fits) = match size {
            Size::Holds(count) => (
                format!("a picture of {count} pixels, of which a few may be left"),
                (count..=2 * count + MORE).contains(&(width * height)),
            ),
            Size::Columns(columns, count) => (
                format!("a picture of {columns} columns and {} rows", count.div_ceil(columns)),
                width == columns && (count..=2 * count + MORE).contains(&(width * height)),
            ),
        };
        if !fits {
            return Err(Error::invalid(path, name, expected, format!("{width}x{height} pixels")));
        }
        let bytes = decoder.output_buffer_size().unwrap_or(0);
        let mut data = vec![0; bytes];
        decoder.read_image(&mut data).map_err(invalid)?;
        let pixels = if decoder.has_alpha() {
            data.as_chunks().0.to_vec()
        } else {
            data.as_chunks().0.iter().map(|[r, g, b]| [*r, *g, *b, 255]).collect()
        };
        Ok(Self { width, height, pixels })
    }

    /// Encodes the picture, with or without prediction of pixels from others, whichever is smaller.
    pub(super) fn encoded(&self) -> io::Result<Vec<u8>> {
        let encode = |predict: bool| -> io::Result<Vec<u8>> {
            let mut parameters = EncoderParams::default();
            parameters.use_predictor_transform = predict;
            let mut data = Vec::new();
            let mut encoder = WebPEncoder::new(&mut data);
            encoder.set_params(parameters);
            let (width, height) = (self.width as u32, self.height as u32);
            encoder.encode(self.pixels.as_flattened(), width, height, ColorType::Rgba8).map_err(io::Error::other)?;
            Ok(data)
        };
        let (plain, predicted) = (encode(false)?, encode(true)?);
        Ok(if plain.len() <= predicted.len() { plain } else { predicted })
    }
}
