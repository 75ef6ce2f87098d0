//! The networks from photos to cameras and Gaussians, SplatWeaver and 2Xplat: configurations, presets, forward passes.

mod config;
mod guidance;
mod parts;
mod splatweaver;
mod stereo;
mod two_experts;

pub use config::{
    BackboneConfig, CameraConfig, DenseConfig, GaussianConfig, ModelConfig, PRESETS, ParametrizationConfig, PixelPoint,
    PoseFrame, RasterConfig, StereoConfig, WaveletKind,
};
pub use guidance::Guidance;
pub use splatweaver::{Dense, PredictedGaussians, SplatWeaver};
pub use two_experts::{AppearanceConfig, GeometryConfig, PixelGaussians, TwoExperts, TwoExpertsConfig};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
