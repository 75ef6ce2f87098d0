//! Scenes of photos, captures on disk, estimated cameras, and view sampling.
//!
//! A [`Scene`] is photos of one place with their cameras and, where known, depth and surface points.
//! [`capture`] loads scenes from photos on disk, [`estimate_photos`] finds their cameras where none are known.
//! [`training_tuple`] and [`evaluation_tuples`] choose the views that the network is given and those that it must
//! render. A [`film::Film`] is photos of a scene that moves, each with its time, read from the layouts of D-NeRF,
//! Neural 3D Video and HyperNeRF.

pub mod capture;
mod error;
mod estimated;
pub mod film;
mod layout;
mod placement;
mod placing;
mod remarks;
mod sampler;
mod scene;
mod sparse_points;
mod spheres;
mod tuple;
mod undistorted;
mod unreadable;

pub use capture::posed;
pub use error::Error;
pub use estimated::{
    CameraSummary, CamerasSummary, Doubt, EstimatePhotosOptions, EstimatedContext, EstimatedPhotos, built_in_matcher,
    estimate_masked_photos, estimate_photos, estimate_set, read_matcher,
};
pub use layout::Layout;
pub use placement::{BarFit, Placement, PositionsFit};
pub use placing::Placing;
pub use remarks::some_of;
pub use sampler::{Sampler, bounded_gap, evaluation_tuples, training_tuple, uniform};
pub use scene::{NormalizedPoses, Scene, View};
pub use sparse_points::SparsePoints;
pub use spheres::{PhotoSet, Projection, SphereOptions};
pub use tuple::Tuple;
pub use weaver_io::OutputFolder;
pub use weaver_sfm::{Confidence, Find, LeftOut, Uncertainty};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
