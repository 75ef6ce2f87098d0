//! A picture as a sum of 2-D Gaussians.
//!
//! - [`Gaussians`] is the model, [`Canvas`] draws a window of it and passes gradients back, [`Gaussians::at_scale`] is the same
//!   picture at another size.
//! - [`Values`] is the drawing as a linear map from colors to pixels, for the solvers of weaver-lift.
//! - [`reference`] is the model written as a plain loop.
//!
//! Same bits at any number of threads.

mod canvas;
mod error;
mod gaussians;
mod lists;
mod operator;
mod passes;
mod record;
pub mod reference;
mod tile;
mod window;

pub use canvas::{CUT, Canvas};
pub use error::ImageError;
pub use gaussians::Gaussians;
pub use operator::Values;
pub use window::{Tiled, Window};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
