//! Poses, cameras, intrinsics, lenses, pose encodings, spherical harmonics and alignment; no tensors.
//!
//! Conventions: world-to-camera poses, OpenCV axes (x right, y down, z forward), pixel centers at +0.5,
//! quaternions in wxyz order.

mod align;
pub mod axes;
mod camera;
mod distortion;
pub mod fov;
pub mod geodesy;
pub mod lens;
mod pose;
pub mod pose_code;
pub mod se3;
pub mod sh;
pub mod so3;
pub mod trajectory;
mod undistortion;

pub use align::Similarity;
pub use camera::{Camera, Intrinsics};
pub use distortion::Distortion;
pub use glam;
pub use pose::{NotRigid, Pose};
pub use undistortion::Undistortion;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
