//! Losses on images, poses, depth and routing, and image metrics without a tape.
//!
//! A loss is a function from tensors on a tape to a scalar on the same tape, or to one number per image that can be
//! weighted. Its weight in a sum of losses, and when it is switched on, is left to the caller. A [metric](metrics) is a
//! plain function of slices; so is the [photometric loss](Photometric) that Gaussians are fitted by, with its gradient,
//! and so are the losses of surfaces, [`depth_loss`] and [`normal_loss`]. Without the default feature `tape` there are
//! these alone.

mod color_map;
pub mod metrics;
mod photometric;
#[cfg_attr(not(feature = "tape"), expect(dead_code, reason = "only the tape needs gradients and masks of windows"))]
mod ssim_window;
mod surfaces;
#[cfg(feature = "tape")]
mod tape;

pub use color_map::ColorMap;
pub use photometric::{Photometric, PhotometricValue};
pub use ssim_window::Covariance;
pub use surfaces::{Relief, depth_loss, normal_loss};
#[cfg(feature = "tape")]
pub use tape::*;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
