//! A differentiable rasterizer of 3-D Gaussians on the CPU, with gradients with respect to every parameter and the
//! camera.
//!
//! - [`rasterize`] and [`rasterize_backward`] are plain functions on slices; a [`Workspace`] is all the memory they
//!   use.
//! - [`Rasterize`] is an operation on the tape, for any [`Rasterizer`], this one unless another is given.
//! - [`RasterSettings`] holds the rules of drawing, and the [`Region`] of the image to draw.
//! - [`BlendWeights`] are the weights of an image, kept: other features are then blended by a sparse product.
//! - [`GaussianStatistics`] are by-products of a backward pass that density control decides by.
//! - [`tiles`] sorts, bins and blends primitives of any shape, seen by any camera.
//! - [`RasterizePrimitives`] is an operation on the tape for such primitives: one says how it is projected and
//!   differentiated ([`Primitive`]).
//! - What is on the tape comes with the default feature `tape`.
//! - [`mod@reference`] computes images and gradients again, slowly and in another way, to test against.
//!
//! Conventions: world-to-camera matrices, OpenCV axes (x right, y down, z forward), pixel centers at +0.5, quaternions
//! wxyz, spherical harmonics as in the reference 3DGS implementation.

mod blend_weights;
mod columns;
mod cpu_rasterizer;
mod depth;
mod each;
mod error;
mod ewa;
mod extent;
mod gaussian_pass;
mod gradients;
mod lens;
mod matrix;
mod memory;
mod project;
mod project_backward;
mod rasterize;
mod rasterize_backward;
mod rasterizer;
pub mod reference;
mod render;
mod rotation;
mod settings;
mod sh;
mod shape;
mod splats;
mod statistics;
mod statistics_pass;
#[cfg(feature = "tape")]
mod tape;
pub mod tiles;
mod view;
mod workspace;

pub use blend_weights::BlendWeights;
pub use cpu_rasterizer::CpuRasterizer;
pub use depth::{expected_depth, expected_depth_backward};
pub use error::RasterError;
pub use extent::Extent;
pub use gradients::{Cotangents, Gradients, Target};
pub use rasterize::rasterize;
pub use rasterize_backward::rasterize_backward;
pub use rasterizer::{AnyRasterizer, Images, RasterStats, Rasterizer, Session};
pub use render::{Renderer, render};
pub use settings::RasterSettings;
pub use splats::{ScreenGradient, Splat};
pub use statistics::GaussianStatistics;
#[cfg(feature = "tape")]
pub use tape::{
    GaussianVars, PixelSums, Primitive, Rasterize, RasterizePrimitives, RenderedVars, SharedStatistics, TilesPool,
    WorkspacePool, covariance,
};
pub use tiles::{Compared, Region, TileSide};
pub use view::{CAMERA_SUMS, View};
pub use workspace::{Timings, Workspace};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
