#![doc = include_str!("../README.md")]

mod aggregation;
mod block;
mod gaussians;
mod merge;
mod opacity;
mod positions;
mod pyramid;

pub use gaussians::{Parametrization, RawGaussians};
pub use opacity::{Opacities, OpacityDegree};
pub use pyramid::{Features, Pyramid, PyramidConfig};
