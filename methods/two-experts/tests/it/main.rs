//! 2Xplat's networks, and their training on the micro preset.

#[cfg(feature = "training")]
#[path = "../../../../crates/app/trainer/tests/it/capture.rs"]
mod capture;
#[cfg(feature = "training")]
mod perceptual;
mod pyramid;
#[cfg(feature = "training")]
#[path = "../../../../crates/app/trainer/tests/it/same_bits.rs"]
mod same_bits;
#[cfg(feature = "training")]
mod training;
