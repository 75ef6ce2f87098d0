//! SplatWeaver put together: configuration, presets and the forward pass from photos to Gaussians.

mod config;
mod parts;
mod splatweaver;

pub use config::{
    BackboneConfig, CameraConfig, DenseConfig, GaussianConfig, ModelConfig, PRESETS, ParametrizationKind, PoseFrame,
    RasterConfig, WaveletKind,
};
pub use splatweaver::{Dense, SplatWeaver, Woven};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
