//! Scenes, captures, view sampling, and the procedural scene generator.
//!
//! A [`Scene`] is photos of one place with their cameras and, where known, depth and surface points. [`capture`] loads
//! scenes from photos on disk, [`procedural`] generates them from a seed, [`appearance`] gives their photos light and
//! passers-by. [`training_tuple`] and [`evaluation_tuples`] choose the views that the network is given and those that
//! it must render. A [`film::Film`] is photos of a scene that moves, each with its time: generated from a seed, or read
//! from the layouts of D-NeRF, Neural 3D Video and HyperNeRF. [`lidar`] has sweeps of a spinning sensor through worlds
//! of boxes.

pub mod appearance;
pub mod capture;
mod error;
mod estimated;
pub mod film;
mod layout;
pub mod lidar;
pub mod procedural;
mod remarks;
mod sampler;
mod scene;
mod sparse_points;
mod tuple;
mod undistorted;
mod unreadable;

pub use capture::posed;
pub use error::Error;
pub use estimated::{
    CameraSummary, CamerasSummary, Doubt, EstimatePhotosOptions, EstimatedContext, EstimatedPhotos, estimate_photos,
};
pub use layout::Layout;
pub use remarks::some_of;
pub use sampler::{Sampler, bounded_gap, evaluation_tuples, training_tuple, uniform};
pub use scene::{NormalizedPoses, Scene, View};
pub use sparse_points::SparsePoints;
pub use tuple::Tuple;
pub use weaver_io::OutputFolder;
pub use weaver_sfm::{Confidence, Find, LeftOut, Uncertainty};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
