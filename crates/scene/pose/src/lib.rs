//! Differentiable camera geometry: pose codes, rotations, unprojection, and the change to the first camera's frame; and
//! errors of estimated poses and the [`descent`] of a camera, without a tape.
//!
//! A pose code holds nine numbers, `[T (3) | quaternion xyzw (4) | field of view (vertical, horizontal)]`: a
//! world-to-camera transform in OpenCV axes, and angles in radians. The quaternion's scalar comes last because the
//! published models are trained with this order; outside of pose codes quaternions are wxyz.

pub mod code;
pub mod descent;
mod frame;
mod gauge;
mod harmonics;
mod metrics;
mod plane_sweep;
mod projection;
mod rays;
mod relative;
mod rotation;
mod row_map;
mod unproject;

pub use code::{CameraVars, activate, cameras, cameras_with, encode};
pub use frame::{AverageFrame, average_frame};
pub use gauge::first_camera_gauge;
pub use harmonics::harmonics;
pub use metrics::{PoseErrors, auc};
pub use plane_sweep::plane_sweep;
pub use projection::projections;
pub use rays::Rays;
pub use relative::relative_poses;
pub use rotation::{quaternion_product, rotation_from_xyzw, xyzw_from_rotation};
pub use unproject::unproject;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
