//! From pixel features to a compact set of Gaussians: cardinality experts, attention over neighbors, and the decoding
//! of raw parameters.
//!
//! Everything works on one scene: V views of H x W pixels, P = V H W pixels in (view, row, column) order. Which pixels
//! get how many Gaussians is decided by an allocation of [`weaver_router`].

mod decode;
mod experts;
mod head;
mod local_count;
mod neighbor_average;
mod neighbor_offset;
mod neighbor_relation;
mod neighbors;
mod parametrization;
mod patches;
mod place;
mod predictor;
mod routes;
mod surface;
mod two_layers;

pub use decode::{Origin, PatchOf, PixelOf, decode};
pub use experts::CardinalityExperts;
pub use head::{CardinalityHead, HeadConfig, NeighborConfig, PixelGaussians, PixelInputs, Proposed};
pub use local_count::local_count;
pub use neighbor_average::neighbor_average;
pub use neighbor_offset::neighbor_offset;
pub use neighbor_relation::neighbor_relation;
pub use neighbors::Neighbors;
pub use parametrization::{Parametrization, slot_width};
pub use patches::{Patches, PixelLists, patch_mean};
pub use place::place;
pub use predictor::{NeighborFusion, NeighborPredictor};
pub use routes::Routes;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
