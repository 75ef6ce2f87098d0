//! Haar and db2 wavelet analysis and synthesis as differentiable operators, and the high-frequency prior.
//!
//! The prior of the method: where the detail sub-bands of an image are strong, the scene is intricate and deserves
//! more Gaussians. [`analysis`] and [`synthesis`] are linear ops with exact adjoints for any image size.

mod analysis;
mod detail_energy;
mod filter;
mod luma;
mod synthesis;
pub mod transform;

pub use analysis::analysis;
pub use detail_energy::{ENERGY_EPSILON, detail_energy, detail_energy_into};
pub use filter::{UnknownWavelet, Wavelet};
pub use luma::{LUMA_WEIGHTS, luma, luma_into};
pub use synthesis::synthesis;
