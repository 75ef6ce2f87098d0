//! Differentiable camera geometry: pose codes, rotations, unprojection, and the change to the first camera's frame; and
//! errors of estimated poses and the [`descent`] of a camera, without a tape, which is all there is without the default
//! feature `tape`.
//!
//! A pose code holds nine numbers, `[T (3) | quaternion xyzw (4) | field of view (vertical, horizontal)]`: a
//! world-to-camera transform in OpenCV axes, and angles in radians. The quaternion's scalar comes last because the
//! published models are trained with this order; outside of pose codes quaternions are wxyz.

pub mod descent;
mod metrics;
mod rotation;
#[cfg(feature = "tape")]
mod tape;

pub use metrics::{PoseErrors, auc};
#[cfg(feature = "tape")]
pub use tape::*;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
