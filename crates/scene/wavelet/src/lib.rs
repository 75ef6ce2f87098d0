//! Haar and db2 wavelet analysis and synthesis as differentiable operators, and the high-frequency energy of images.
//!
//! [`analysis`] and [`synthesis`] are linear ops with exact adjoints for images of any size. The energy of the detail
//! sub-bands shows where an image has fine structure: SplatWeaver's router spends more Gaussians there.

mod analysis;
mod detail_energy;
mod energy;
mod energy_map;
mod filter;
mod luma;
mod synthesis;
pub mod transform;

pub use analysis::analysis;
pub use detail_energy::{ENERGY_EPSILON, detail_energy, detail_energy_into};
pub use energy::energy;
pub use energy_map::EnergyMap;
pub use filter::{UnknownWavelet, Wavelet};
pub use luma::{LUMA_WEIGHTS, luma, luma_into};
pub use synthesis::synthesis;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
