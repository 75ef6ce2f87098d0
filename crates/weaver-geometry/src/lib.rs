//! Poses, cameras, intrinsics, pose encodings, spherical harmonics and alignment; no tensors.
//!
//! Conventions: world-to-camera poses, OpenCV axes (x right, y down, z forward), pixel centres at +0.5,
//! quaternions in wxyz order.

pub mod axes;
mod camera;
mod pose;

pub use camera::{Camera, Intrinsics};
pub use glam;
pub use pose::{NotRigid, Pose};
