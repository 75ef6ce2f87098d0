#![doc = include_str!("../README.md")]

mod comparison;
mod config;
mod filled;
mod kept;
mod network;
mod predictor;
mod prior;
mod simulated;

pub use comparison::{Comparison, FAR};
pub use config::PhotoConfig;
pub use filled::{Filled, filled};
pub use kept::DepthMaps;
pub use network::{Dense, PhotoGaussians, PhotoNetwork, camera_vars};
pub use predictor::PhotoPredictor;
pub use prior::{CHANNELS, PATCH, Prior};

/// The most photos that are predicted from at once.
pub const MOST_PHOTOS: usize = 16;
