//! Compression of scenes of Gaussians: to a wanted quality of their pictures, and by the methods of others; nothing is read from or written to disk.
//!
//! - [`Judge`] draws a scene and compares what is left of it. [`compress`] chooses the steps of [`lite`](weaver_codec::lite);
//!   [`compress_judged`] judges them by other pictures.
//! - [`Surface`] compares surfaces: meshes of the drawn depth.
//! - [`Method`] is a way to compress: real bytes of a scene, and a scene of these bytes alone. [`METHODS`] is the table of them, [`formats()`] the
//!   formats of files as methods.
//! - A method encodes in the steps of a [`Training`], which can be stopped and gone on with; what changes the scene is due on a [`Schedule`].

mod codes;
mod error;
mod gaussian_bits;
mod geometry;
mod hash_grid;
mod judge;
mod judged;
mod method;
mod methods;
mod payload;
mod recovery;
mod schedule;
mod shapes;
mod steps;
mod table;
mod training;
mod views;

pub use error::CompressError;
pub use gaussian_bits::{binary_through, gaussian_bits};
pub use geometry::Surface;
pub use hash_grid::{HashGrid, HashLevel};
pub use judge::{Judge, Pictures};
pub use judged::{Judged, compress_judged};
pub use method::{Method, Point, Task};
pub use methods::{C3dgs, Format, HacLite, Half, LightGaussian, Lite, MesonGs, SpeedySplat, Zstd};
pub use schedule::Schedule;
pub use steps::{Compressed, MOST_DECIBELS, Round, compress};
pub use table::{Family, METHODS, formats};
pub use training::Training;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
