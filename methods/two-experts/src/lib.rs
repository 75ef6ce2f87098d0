#![doc = include_str!("../README.md")]

mod config;
mod network;
mod predictor;
mod pyramid;
#[cfg(feature = "training")]
mod training;

pub use config::{AppearanceConfig, GeometryConfig, TwoExpertsConfig};
pub use network::{PixelGaussians, TwoExperts};
pub use predictor::TwoExpertsPredictor;
pub use pyramid::{Features, Opacities, OpacityDegree, Parametrization, Pyramid, PyramidConfig, RawGaussians};
#[cfg(feature = "training")]
pub use training::{TwoExpertsEvaluation, TwoExpertsLosses, TwoExpertsRecipe, TwoExpertsStage};
