#![doc = include_str!("../README.md")]

mod aggregation;
mod block;
mod gaussians;
mod merge;
mod positions;
mod pyramid;

pub use gaussians::{OpacityDegree, Parametrization, RawGaussians};
pub use pyramid::{Features, Pyramid, PyramidConfig};
