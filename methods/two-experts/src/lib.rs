#![doc = include_str!("../README.md")]

mod config;
mod network;
mod predictor;
mod pyramid;

pub use config::{AppearanceConfig, GeometryConfig, TwoExpertsConfig};
pub use network::{PixelGaussians, TwoExperts};
pub use predictor::TwoExpertsPredictor;
pub use pyramid::{Features, Opacities, OpacityDegree, Parametrization, Pyramid, PyramidConfig, RawGaussians};
