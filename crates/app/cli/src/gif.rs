//! Pictures as a GIF that repeats, without another program.

use crate::film::Film;
use gif::{Encoder, Frame, Repeat};
use std::path::{Path, PathBuf};
use weaver_command::Failure;
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
    pub fn create(path: &Path, (width, height): (usize, usize), rate: f64) -> Result<Self, Failure> {
        let side = |pixels: usize| {
            u16::try_from(pixels).map_err(|_| Failure::Usage("--gif: expected sides up to 65535 pixels".into()))
        };
        let mut encoder = Encoder::new(Vec::new(), side(width)?, side(height)?, &[])?;
        encoder.set_repeat(Repeat::Infinite)?;
        // Browsers show pictures of less than two hundredths slowly.
        let delay = (100.0 / rate).round().clamp(2.0, 6000.0) as u16;
        Ok(Self { path: path.into(), encoder, delay })
    }
}

impl Film for Gif {
    fn push(&mut self, image: &Image) -> Result<(), Failure> {
        let mut frame = Frame::from_rgb_speed(image.width as u16, image.height as u16, &image.to_bytes(), SPEED);
        frame.delay = self.delay;
        Ok(self.encoder.write_frame(&frame)?)
    }

    fn finish(self: Box<Self>) -> Result<PathBuf, Failure> {
        let bytes = self.encoder.into_inner()?;
        atomic_write(&self.path, |w| w.write_all(&bytes))?;
        Ok(self.path)
    }
}
