//! Decides how many Gaussians each pixel of a scene gets: a router scores the choices, straight-through Gumbel sampling
//! trains it, and allocation strategies spend a budget.
//!
//! Everything works on one scene: V views of H x W pixels, P = V H W pixels in (view, row, column) order.

mod allocation;
mod cell;
mod gate;
mod gumbel;
mod router;

pub use allocation::{
    Allocation, AllocationError, AllocationKind, AllocationRequest, Argmax, Assignment, Dithered, Fixed, Grid,
    GumbelGate, Masked, Quadtree, QuadtreeGrid, QuadtreeMix, Random, Sampled, TrainingMix,
};
pub use cell::{Bands, COARSEST, Cell, Cells};
pub use gate::gate;
pub use gumbel::gumbel_softmax_straight_through;
pub use router::Router;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
