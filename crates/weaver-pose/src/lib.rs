//! Camera poses: codes of nine numbers and the cameras they stand for, unprojection, and how wrong a set of poses is.
//!
//! A pose code is `[T (3) | quaternion xyzw (4) | field of view (vertical, horizontal)]`: a world-to-camera
//! transform in OpenCV axes and angles in radians. The quaternion's scalar comes last here because the weights of
//! the published models are trained to it; everything outside a code uses wxyz.

pub mod code;
mod gauge;
mod metrics;
mod rotation;
mod row_map;
mod unproject;

pub use code::{CameraVars, activate, cameras, encode};
pub use gauge::first_camera_gauge;
pub use metrics::{PoseErrors, auc};
pub use rotation::{quaternion_product, rotation_from_xyzw, xyzw_from_rotation};
pub use unproject::unproject;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
