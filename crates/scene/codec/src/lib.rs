//! Compression of scenes of Gaussians: quantizers, models, a range coder, transforms, and a container; no tape, no
//! files.
//!
//! - [`Coder`] is a direction: [`RangeEncoder`], [`RangeDecoder`], or [`CodeLength`], which only counts. A stream is
//!   described once, for all three.
//! - [`AdaptiveModel`] codes symbols by their frequencies, [`MixedModel`] numbers by several contexts at once,
//!   [`GaussianModel`] numbers by a normal distribution that is predicted.
//! - [`Quantizer`] makes numbers symbols. [`gaussian_rate`] and [`FactorizedPrior`] say what symbols cost.
//! - [`morton3`], [`code_octree`], [`Raht`] and [`Codebook`] are for positions, and for what varies slowly in space.
//! - [`Container`] holds streams, with sizes and checksums.

mod adaptive;
mod codebook;
mod container;
mod error;
mod estimates;
pub mod exact;
mod factorized;
mod gaussian;
pub mod lite;
mod mixed;
mod morton;
mod octree;
mod quantizer;
mod raht;
mod range;
mod rates;

pub use adaptive::AdaptiveModel;
pub use codebook::Codebook;
pub use container::{Container, Extent, GAUSSIANS_PER_BYTE, Layout, MAGIC, Stream, VERSION};
pub use error::CodecError;
pub use factorized::{FactorizedPrior, PRIOR_PARAMETERS, PriorRate};
pub use gaussian::GaussianModel;
pub use mixed::MixedModel;
pub use morton::{from_morton2, from_morton3, morton2, morton3};
pub use octree::{DEEPEST, code_octree};
pub use quantizer::{LARGEST_SYMBOL, Quantizer, binary};
pub use raht::Raht;
pub use range::{CodeLength, Coder, PRECISION, RangeDecoder, RangeEncoder, Slices, Uniform, WHOLE};
pub use rates::{GaussianRate, LEAST_PROBABILITY, gaussian_rate};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
