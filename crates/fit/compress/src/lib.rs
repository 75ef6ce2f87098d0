//! Compression of scenes of Gaussians to a wanted quality of their pictures; nothing is read from or written to disk.
//!
//! [`Judge`] draws a scene and compares what is left of it. [`compress`] chooses the steps of
//! [`lite`](weaver_codec::lite); [`compress_judged`] judges them by other pictures.

mod error;
mod judge;
mod judged;
mod steps;

pub use error::CompressError;
pub use judge::{Judge, Pictures};
pub use judged::{Judged, compress_judged};
pub use steps::{Compressed, MOST_DECIBELS, Round, compress};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
