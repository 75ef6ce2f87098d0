//! `lite`, the codec of .wsz files.

use crate::method::Point;
use crate::training::Untrained;
use crate::{CompressionError, Method, Task, Training};
use weaver_codec::lite;
use weaver_compress::{Judge, compress};
use weaver_scene::Gaussians;

/// Compared qualities, dB.
const QUALITIES: [f64; 5] = [50.0, 46.0, 43.0, 40.0, 37.0];

/// The codec of .wsz files, with steps measured for a quality of the task's pictures.
#[derive(Clone, Copy, Debug)]
pub struct Lite {
    /// The quality, dB.
    pub decibels: f64,
}

impl Lite {
    pub(crate) fn points() -> Vec<Point> {
        let point = |decibels| Point { setting: format!("{decibels} dB"), method: Box::new(Self { decibels }) };
        QUALITIES.map(point).into()
    }
}

impl Method for Lite {
    fn begin<'a>(&'a self, task: &'a Task<'a>) -> Result<Box<dyn Training + 'a>, CompressionError> {
        Ok(Box::new(Untrained(|| {
            let mut judge = Judge::new(task.gaussians, &task.pictures)?;
            Ok(compress(task.gaussians, self.decibels, &mut judge, |_| {})?.bytes)
        })))
    }

    fn decode(&self, bytes: &[u8]) -> Result<Gaussians, CompressionError> {
        Ok(lite::decode(bytes)?)
    }
}
