//! A picture as a sum of 2-D Gaussians.
//!
//! - [`fit`] fits [`Gaussians`] to a [`Picture`]: from a [`quadtree()`] or as published, by [`FitSettings`];
//!   [`solve_colors`] is its linear algebra.
//! - [`Canvas`] draws a window of Gaussians and passes gradients back; [`Gaussians::at_scale`] is the same picture at
//!   another size.
//! - [`encode`] and [`decode`] are the codec of files, [`decode_region`] reads a part. [`Fit`] goes step by step and
//!   can be interrupted and resumed.
//! - [`Values`] is the drawing as a linear map from colors to pixels, for the solvers of weaver-lift.
//! - [`mod@reference`] is the model as a plain loop, [`metrics`] measures the difference of two pictures.
//!
//! Same bits at any number of threads.

mod adam;
mod blocks;
mod bounds;
mod canvas;
mod colors;
#[cfg(feature = "command")]
pub mod command;
mod error;
mod file;
mod fit;
mod gaussians;
mod lists;
pub mod metrics;
mod operator;
mod passes;
mod picture;
mod quadtree;
mod record;
pub mod reference;
mod rounding;
mod sampling;
mod settings;
mod start;
mod state;
mod step;
mod symbols;
mod tile;
mod window;

pub use canvas::{CUT, Canvas};
pub use colors::solve_colors;
pub use error::ImageError;
pub use file::{Coded, decode, decode_region, encode, encode_in_blocks};
pub use fit::{Fit, Fitted, Progress, fit, refine};
pub use gaussians::Gaussians;
pub use operator::Values;
pub use picture::Picture;
pub use quadtree::{Leaf, quadtree};
pub use settings::{Descent, FitSettings};
pub use start::{Start, start};
pub use state::FitState;
pub use window::{Tiled, Window};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
