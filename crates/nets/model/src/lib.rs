//! SplatWeaver, the network from photos to cameras and Gaussians: configuration, presets, forward pass; and the parts
//! of a configuration that other models share with it.

mod config;
mod guidance;
mod parts;
mod splatweaver;
mod stereo;

pub use config::check;
pub use config::{
    BackboneConfig, CameraConfig, DenseConfig, GaussianConfig, ModelConfig, PRESETS, ParametrizationConfig, PixelPoint,
    PoseFrame, RasterConfig, StereoConfig, WaveletKind,
};
pub use guidance::Guidance;
pub use splatweaver::{Dense, PredictedGaussians, SplatWeaver};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
