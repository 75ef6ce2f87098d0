//! The networks from photos to cameras and Gaussians, SplatWeaver, 2Xplat and WildSplatter: configurations, presets, forward passes.

mod config;
mod guidance;
mod parts;
mod splatweaver;
mod stereo;
mod two_experts;
mod wild;

pub use config::{
    BackboneConfig, CameraConfig, DenseConfig, GaussianConfig, ModelConfig, PRESETS, ParametrizationConfig, PixelPoint,
    PoseFrame, RasterConfig, StereoConfig, WaveletKind,
};
pub use guidance::Guidance;
pub use splatweaver::{Dense, PredictedGaussians, SplatWeaver};
pub use two_experts::{AppearanceConfig, GeometryConfig, PixelGaussians, TwoExperts, TwoExpertsConfig};
pub use wild::{LookConfig, Surface, Wild, WildConfig, WildDenseConfig, WildGaussianConfig, WildParametrization};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
