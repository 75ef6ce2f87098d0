//! SplatWeaver put together: configuration, presets and the forward pass from photos to Gaussians.

mod config;
mod parts;
mod splatweaver;
mod vggt;

pub use config::{
    BackboneConfig, CameraConfig, DenseConfig, Gauge, GaussianConfig, ModelConfig, PRESETS, ParametrizationKind,
    RasterConfig, WaveletKind,
};
pub use splatweaver::{Dense, SplatWeaver, Woven};
pub use vggt::{Encoded, Vggt};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
