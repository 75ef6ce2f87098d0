//! Controls: the gain by general packing, and by the choice of Gaussians.

use super::format::{from_ply, ply};
use crate::method::Point;
use crate::training::Untrained;
use crate::{CompressionError, Method, Task, Training};
use ruzstd::decoding::StreamingDecoder;
use ruzstd::encoding::{CompressionLevel, compress_to_vec};
use std::io::Read;
use weaver_kernels::random::Stream;
use weaver_scene::Gaussians;

/// A PLY packed by zstd.
#[derive(Clone, Copy, Debug)]
pub struct Zstd;

impl Zstd {
    pub(crate) fn points() -> Vec<Point> {
        vec![Point { setting: String::new(), method: Box::new(Self) }]
    }
}

/// Most times by which unpacking may lengthen a packed PLY.
const LONGER: u64 = 64;

impl Method for Zstd {
    fn begin<'a>(&'a self, task: &'a Task<'a>) -> Result<Box<dyn Training + 'a>, CompressionError> {
        Ok(Box::new(Untrained(|| Ok(compress_to_vec(&ply(task.gaussians)?[..], CompressionLevel::Fastest)))))
    }

    fn decode(&self, bytes: &[u8]) -> Result<Gaussians, CompressionError> {
        let broken =
            |found: String| CompressionError::Stream { place: "zstd".into(), expected: "a frame".into(), found };
        let decoder = StreamingDecoder::new(bytes).map_err(|error| broken(error.to_string()))?;
        let mut ply = Vec::new();
        let most = LONGER * bytes.len() as u64 + (1 << 16);
        decoder.take(most).read_to_end(&mut ply).map_err(|error| broken(error.to_string()))?;
        from_ply(&ply)
    }
}

/// A PLY of half of the Gaussians.
#[derive(Clone, Copy, Debug)]
pub struct Half {
    /// True for the more important half, false for a random one.
    pub important: bool,
}

impl Half {
    pub(crate) fn important() -> Vec<Point> {
        vec![Point { setting: String::new(), method: Box::new(Self { important: true }) }]
    }

    pub(crate) fn random() -> Vec<Point> {
        vec![Point { setting: String::new(), method: Box::new(Self { important: false }) }]
    }
}

impl Method for Half {
    fn begin<'a>(&'a self, task: &'a Task<'a>) -> Result<Box<dyn Training + 'a>, CompressionError> {
        Ok(Box::new(Untrained(|| self.half(task))))
    }

    fn decode(&self, bytes: &[u8]) -> Result<Gaussians, CompressionError> {
        from_ply(bytes)
    }
}

impl Half {
    fn half(self, task: &Task<'_>) -> Result<Vec<u8>, CompressionError> {
        let (gaussians, count) = (task.gaussians, task.gaussians.len().div_ceil(2));
        let numbers = if self.important {
            gaussians.largest(&gaussians.importance(), count)
        } else {
            let mut drawn = Stream::new(task.seed, 0, "compress.half").permutation(gaussians.len());
            drawn.truncate(count);
            drawn.sort_unstable();
            drawn
        };
        ply(&gaussians.select(&numbers))
    }
}
