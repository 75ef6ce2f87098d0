//! The scene types of Gaussian splatting: Gaussians, cameras and points, and the conversions between their forms.
//!
//! | type | form | who uses it |
//! |---|---|---|
//! | [`Gaussians`] | stored: log scales, opacity logits | files |
//! | [`ActivatedGaussians`] | activated: standard deviations, opacities | the output of a network, the input of a rasterizer |
//! | [`GaussianSlices`] | activated, borrowed | rasterizers |
//! | [`Frame`] | a camera with the name of its photo | camera files |
//! | [`Photo`] | a camera with the pixels of its photo | the input of fits and of their evaluation |
//! | [`Pixels`] | bytes in memory, or kept elsewhere | photos that memory has no room for |
//! | [`CameraSlices`] | matrices and intrinsics, borrowed | rasterizers |
//! | [`PointCloud`] | positions with colors | point files |
//!
//! Conventions: world-to-camera poses, OpenCV axes (x right, y down, z forward), pixel centers at +0.5, quaternions
//! wxyz, spherical harmonics as in the reference 3DGS implementation.

mod activated;
mod camera_path;
mod cameras;
mod difference;
pub mod forms;
mod frame;
mod gaussians;
mod keyframes;
mod merge;
mod orbit;
mod photo;
mod pixels;
mod points;
mod prune;
mod select;
mod slices;
mod transform;

pub use activated::ActivatedGaussians;
pub use camera_path::CameraPath;
pub use cameras::{CameraRows, CameraSlices, Model, intrinsics_row, viewmat};
pub use difference::{Difference, Errors};
pub use frame::{Frame, stems};
pub use gaussians::Gaussians;
pub use keyframes::{InvalidKeys, Keyframes};
pub use orbit::{middle, orbit};
pub use photo::Photo;
pub use pixels::{KeptBytes, Pixels};
pub use points::PointCloud;
pub use prune::Region;
pub use slices::{Color, Features, GaussianSlices, Groups};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
