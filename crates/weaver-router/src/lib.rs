//! From pixel features to a compact set of Gaussians: the router, its allocation strategies, the cardinality experts,
//! the neighbor search and attention, and the decoding of raw parameters.
//!
//! Everything works on one scene: V views of H x W pixels, P = V H W pixels in (view, row, column) order.

mod allocation;
mod decode;
mod experts;
mod gate;
mod gumbel;
mod head;
mod local_count;
mod neighbor_average;
mod neighbor_offset;
mod neighbor_relation;
mod neighbors;
mod parametrization;
mod place;
mod predictor;
mod router;
mod routes;
mod two_layers;

pub use allocation::{
    Allocation, AllocationError, AllocationKind, AllocationRequest, Argmax, Assignment, Dithered, Fixed, Grid,
    GumbelGate, Random, Sampled, TrainingMix,
};
pub use decode::{Decoded, PixelOf, decode};
pub use experts::CardinalityExperts;
pub use gate::gate;
pub use gumbel::gumbel_softmax_straight_through;
pub use head::{CardinalityHead, Gaussians, HeadConfig, NeighborConfig, PixelInputs, Proposed};
pub use local_count::local_count;
pub use neighbor_average::neighbor_average;
pub use neighbor_offset::neighbor_offset;
pub use neighbor_relation::neighbor_relation;
pub use neighbors::Neighbors;
pub use parametrization::{Parametrization, slot_width};
pub use place::place;
pub use predictor::{NeighborFusion, NeighborPredictor};
pub use router::Router;
pub use routes::Routes;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
