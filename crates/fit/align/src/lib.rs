//! Cameras of further photos of a finished scene of Gaussians: the camera descends through the rasterizer, the scene
//! stays.
//!
//! - [`align`] finds the cameras of photos from first guesses, on slices, with any
//!   [`Rasterizer`](weaver_splat::Rasterizer).
//! - [`Descent`], of weaver-pose, is the bare descent of one camera under gradients of anybody's loss; [`Method`] its
//!   published variants and ours.
//!
//! An aligned photo has been looked at: its gain in PSNR belongs beside the figures without alignment, never in their
//! place.
//!
//! Sources: NoPoSplat (Ye et al., arXiv 2410.24207), 2Xplat (Jeong et al., arXiv 2603.21064); both align poses before
//! they judge held-out views.

mod align;
mod drawing;
mod error;

pub use align::{Aligned, Options, Outcome, align};
pub use drawing::{Photo, Scene, mean_square};
pub use error::AlignError;
pub use weaver_pose::descent::{Descent, Method};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
