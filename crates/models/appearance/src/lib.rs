//! WildSplatter's looks (Fujimura et al., arXiv 2604.21182): what is of a photo's moment and not of the place.

mod decoder;
mod encoder;
mod standardized;

pub use decoder::{LookDecoder, LookDecoderConfig};
pub use encoder::{AppearanceEncoder, AppearanceEncoderConfig};
pub use standardized::{LEAST_DEVIATION, standardized};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
