//! WildSplatter's network and its parts, and its training on the micro preset.

#[cfg(feature = "training")]
#[path = "../../../../crates/app/trainer/tests/it/capture.rs"]
mod capture;
mod light;
mod network;
#[cfg(feature = "training")]
#[path = "../../../../crates/app/trainer/tests/it/same_bits.rs"]
mod same_bits;
#[cfg(feature = "training")]
mod training;
