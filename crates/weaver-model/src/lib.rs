//! The SplatWeaver network: its configuration, its presets, and the forward pass from photos to cameras and Gaussians.

mod config;
mod guidance;
mod parts;
mod splatweaver;
mod stereo;

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
