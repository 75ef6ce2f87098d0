//! A capture too large for one fit, cut into blocks that are fitted apart and joined.
//!
//! 1. [`regions`] cuts space by planes that stand on the ground, so that every region has as many points as any other.
//! 2. [`blocks`] gives each region the photos that see enough of it, and the points that these photos see.
//! 3. Each block is fitted anywhere, by whatever fits captures.
//! 4. [`color_maps`] brings the colors of fits that correct those of their photos together.
//! 5. [`merged`] keeps of each fit the Gaussians whose centers lie in its region.
//!
//! Regions do not overlap and leave no gap: each center belongs to exactly one.

mod blocks;
mod colors;
mod error;
mod ground;
mod merge;
mod region;

pub use blocks::{Block, BlockOptions, Sight, Sights, blocks};
pub use colors::{ColorMap, color_maps};
pub use error::BlockError;
pub use ground::ground_axes;
pub use merge::merged;
pub use region::{Cut, Region, regions};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
