//! Published methods of compressing scenes of Gaussians behind one trait, for comparison with the product's own; except
//! for the [`command`], nothing is read from or written to disk.
//!
//! - [`Method`] is a way to compress: real bytes of a scene, and a scene from these bytes alone. [`METHODS`] is their
//!   table, [`formats()`] the formats of files as methods.
//! - A method encodes in the steps of a [`Training`], which can be interrupted and resumed; changes of the scene are
//!   due on a [`Schedule`].
//! - [`Surface`] compares surfaces: meshes of the drawn depth.

mod codes;
#[cfg(feature = "command")]
pub mod command;
mod error;
mod gaussian_bits;
mod geometry;
mod hash_grid;
mod method;
mod methods;
mod payload;
mod recovery;
mod schedule;
mod shapes;
mod table;
mod training;
mod views;

pub use error::CompressionError;
pub use gaussian_bits::{binary_through, gaussian_bits};
pub use geometry::Surface;
pub use hash_grid::{HashGrid, HashLevel};
pub use method::{Method, Point, Task};
pub use methods::{C3dgs, Format, HacLite, Half, LightGaussian, Lite, MesonGs, SpeedySplat, Zstd};
pub use schedule::Schedule;
pub use table::{Family, METHODS, formats};
pub use training::Training;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
