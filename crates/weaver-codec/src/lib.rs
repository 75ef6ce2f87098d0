//! Compression of scenes of Gaussians: quantizers, models, a range coder, transforms, and a container; no tape, no files.

mod adaptive;
mod logistic;
mod mixed;
mod range;

pub use adaptive::AdaptiveModel;
pub use mixed::MixedModel;
pub use range::{CodeLength, Coder, PRECISION, RangeDecoder, RangeEncoder, Slices, Uniform, WHOLE};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
