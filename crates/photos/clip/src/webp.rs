//! Pictures as a WebP that repeats, without another program: each is coded without loss by image-webp, which leaves the
//! frame of a moving file to others.

use crate::{Error, Film};
use image_webp::{ColorType, WebPEncoder};
use std::path::{Path, PathBuf};
use weaver_io::{Image, atomic_write};

/// The longest side that the format can say.
const LONGEST: usize = 1 << 14;
/// Bytes before the first part of a file: `RIFF`, a length and `WEBP`.
const HEAD: usize = 12;
/// The bit of a file with several pictures.
const MOVING: u8 = 2;
/// The bit of a picture that replaces what is below it.
const REPLACES: u8 = 2;

/// A WebP in memory until it is complete.
#[derive(Debug)]
pub struct WebP {
    path: PathBuf,
    /// Parts of the file behind its head.
    parts: Vec<u8>,
    /// Thousandths of a second per picture.
    delay: u32,
}

impl WebP {
    /// A WebP of pictures of this size, `rate` of them a second: the format counts thousandths of a second.
    pub fn create(path: &Path, (width, height): (usize, usize), rate: f64) -> Result<Self, Error> {
        if width.max(height) > LONGEST {
            return Err(Error::setting("webp", format!("expected sides up to {LONGEST} pixels")));
        }
        let mut parts = Vec::new();
        part(&mut parts, b"VP8X", &[&[MOVING, 0, 0, 0][..], &size(width, height)].concat());
        // A background that nothing shows, and no end of repeating.
        part(&mut parts, b"ANIM", &[0; 6]);
        Ok(Self { path: path.into(), parts, delay: (1000.0 / rate).round().clamp(1.0, 60_000.0) as u32 })
    }
}

impl Film for WebP {
    fn push(&mut self, image: &Image) -> Result<(), Error> {
        let mut file = Vec::new();
        WebPEncoder::new(&mut file)
            .encode(&image.to_bytes(), image.width as u32, image.height as u32, ColorType::Rgb8)
            .map_err(|error| Error::input(error.to_string()))?;
        let frame = [&[0; 6][..], &size(image.width, image.height), &self.delay.to_le_bytes()[..3], &[REPLACES]];
        part(&mut self.parts, b"ANMF", &[&frame.concat()[..], &file[HEAD..]].concat());
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<PathBuf, Error> {
        let length = u32::try_from(self.parts.len() + 4).map_err(|_| {
            Error::input(format!("{}: expected less than 4 GB; a smaller --width helps", self.path.display()))
        })?;
        let head = [&b"RIFF"[..], &length.to_le_bytes(), b"WEBP"].concat();
        atomic_write(&self.path, |w| {
            w.write_all(&head)?;
            w.write_all(&self.parts)
        })?;
        Ok(self.path)
    }
}

/// Width and height, less one, in three bytes each.
fn size(width: usize, height: usize) -> Vec<u8> {
    [width, height].iter().flat_map(|side| (*side as u32 - 1).to_le_bytes()[..3].to_vec()).collect()
}

/// Adds a part: name, length, content, and a byte where the length is odd.
fn part(parts: &mut Vec<u8>, name: &[u8; 4], content: &[u8]) {
    parts.extend_from_slice(name);
    parts.extend_from_slice(&(content.len() as u32).to_le_bytes());
    parts.extend_from_slice(content);
    if !content.len().is_multiple_of(2) {
        parts.push(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image_webp::WebPDecoder;
    use std::io::Cursor;

    /// Another decoder of the format sees the pictures, to the bit, and their times.
    #[test]
    fn a_decoder_sees_the_pictures() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.webp");
        let image = |i: usize| {
            let value = |at: usize| ((at * 7 + i * 31) % 256) as f32 / 255.0;
            Image { width: 5, height: 3, pixels: (0..45).map(value).collect() }
        };
        let mut film = Box::new(WebP::create(&path, (5, 3), 25.0).unwrap());
        (0..4).for_each(|i| film.push(&image(i)).unwrap());
        film.finish().unwrap();
        let mut decoder = WebPDecoder::new(Cursor::new(std::fs::read(&path).unwrap())).unwrap();
        assert_eq!((decoder.dimensions(), decoder.num_frames(), decoder.loop_duration()), ((5, 3), 4, 160));
        let mut pixels = vec![0; decoder.output_buffer_size().unwrap()];
        for i in 0..4 {
            assert_eq!(decoder.read_frame(&mut pixels).unwrap(), 40);
            assert_eq!(pixels, image(i).to_bytes());
        }
    }
}
