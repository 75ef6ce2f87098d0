#![doc = include_str!("../README.md")]

mod config;
mod network;
mod predictor;
#[cfg(feature = "training")]
mod training;

pub use config::{LookConfig, WildConfig, WildDenseConfig, WildGaussianConfig, WildParametrization};
pub use network::{
    AppearanceEncoder, AppearanceEncoderConfig, LEAST_DEVIATION, LookDecoder, LookDecoderConfig, Surface, Wild,
    standardized,
};
pub use predictor::WildPredictor;
#[cfg(feature = "training")]
pub use training::{WildEvaluation, WildLosses, WildRecipe, WildStage};
