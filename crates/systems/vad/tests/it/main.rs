//! Tests of video anomaly detection.

mod annotations;
mod detector;
mod files;
mod fixture;
mod losses;
mod metrics;
mod ops;
mod parity;
mod planted;
mod splatting;
mod training;
