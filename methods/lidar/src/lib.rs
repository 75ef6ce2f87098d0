//! Lidar odometry and mapping with flat Gaussians (surfels), without files: scans in; trajectory and a map of surfels
//! out.
//!
//! - A [`Scan`] has the points of a sweep; a [`Frame`] is its range image.
//! - [`register`] aligns points to a [`PatchTree`], and [`register_ranges`] ranges to a [`RangeReference`], with
//!   reasons of failure ([`Lost`]).
//! - A [`Mapper`] makes surfels of keyframes and fits them by differentiable drawing (weaver-surfel).
//! - [`Odometry`] does both, scan by scan: the next scan is registered to the map as drawn from the last keyframe.
//! - Keyframes that come back to earlier ones ([`LoopSettings`]) bend the trajectory and the map so that all measured
//!   motions agree best ([`optimize_poses`]).
//! - [`trajectory_errors`] compares trajectories.
//!
//! After Splat-LOAM (arXiv 2503.17491). Poses of this crate go from the sensor to the world; frames have x forward, y
//! left, z up.

#[cfg(feature = "command")]
pub mod command;
mod drawn_normals;
mod eigen;
mod error;
mod frame;
mod loops;
mod map_loss;
mod mapper;
mod normal_equations;
mod odometry;
mod pose_graph;
mod range_reference;
mod registration;
mod scan;
mod settings;
mod trajectory;
mod tree;

pub use error::{Error, Result};
pub use frame::Frame;
pub use map_loss::{LossWeights, MapLoss, NormalTarget, RangeMean};
pub use mapper::{Keyframe, MapReport, MapState, Mapper, held_out};
pub use normal_equations::NormalEquations;
pub use odometry::{Odometry, OdometryState, Tracked};
pub use pose_graph::{Edge, optimize_poses};
pub use range_reference::RangeReference;
pub use registration::{GeometricSettings, Lost, Registered, register, register_ranges};
pub use scan::Scan;
pub use settings::{LoopSettings, MapSettings, TrackSettings};
pub use trajectory::{TrajectoryErrors, alignment, trajectory_errors};
pub use tree::{Patch, PatchTree};
pub use weaver_surfel::SurfelCamera;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
