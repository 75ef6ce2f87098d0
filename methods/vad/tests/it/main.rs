//! Tests of video anomaly detection.

mod annotations;
mod detector;
mod files;
mod losses;
mod metrics;
mod ops;
mod parity;
mod planted;
mod real_lists;
mod splatting;
mod training;
