//! Pictures as a GIF that repeats, without another program.

use crate::{Error, Film};
use gif::{Encoder, Frame, Repeat};
use std::path::{Path, PathBuf};
use weaver_io::{Image, atomic_write};

/// Effort of choosing the 256 colors of a picture, from 1, the most, to 30.
const SPEED: i32 = 10;

/// A GIF in memory until it is complete.
pub struct Gif {
    path: PathBuf,
    encoder: Encoder<Vec<u8>>,
    /// Hundredths of a second per picture.
    delay: u16,
}

impl Gif {
    /// A GIF of pictures of this size, about `rate` of them a second: the format counts hundredths of a second.
    pub fn create(path: &Path, (width, height): (usize, usize), rate: f64) -> Result<Self, Error> {
        let side = |pixels: usize| {
            u16::try_from(pixels).map_err(|_| Error::setting("gif", "expected sides up to 65535 pixels"))
        };
        let mut encoder = Encoder::new(Vec::new(), side(width)?, side(height)?, &[]).map_err(refused)?;
        encoder.set_repeat(Repeat::Infinite).map_err(refused)?;
        // Browsers show pictures of less than two hundredths slowly.
        let delay = (100.0 / rate).round().clamp(2.0, 6000.0) as u16;
        Ok(Self { path: path.into(), encoder, delay })
    }
}

fn refused(error: gif::EncodingError) -> Error {
    Error::input(error.to_string())
}

impl std::fmt::Debug for Gif {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Gif").field("path", &self.path).finish_non_exhaustive()
    }
}

impl Film for Gif {
    fn push(&mut self, image: &Image) -> Result<(), Error> {
        let mut frame = Frame::from_rgb_speed(image.width as u16, image.height as u16, &image.to_bytes(), SPEED);
        frame.delay = self.delay;
        self.encoder.write_frame(&frame).map_err(refused)
    }

    fn finish(self: Box<Self>) -> Result<PathBuf, Error> {
        let bytes = self.encoder.into_inner().map_err(|error| Error::input(error.to_string()))?;
        atomic_write(&self.path, |w| w.write_all(&bytes))?;
        Ok(self.path)
    }
}
