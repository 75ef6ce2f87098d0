//! Losses on images, poses, depth and routing, and image metrics without a tape.
//!
//! A loss is a function from tensors on a tape to a scalar on the same tape, or to one number per image that can be
//! weighted. Its weight in a sum of losses, and when it is switched on, is left to the caller. A [metric](metrics) is a
//! plain function of slices; so is the [photometric loss](Photometric) that Gaussians are fitted by, with its gradient.

mod budget;
mod color_map;
mod depth;
mod error_regression;
mod feature_distance;
pub mod lpips;
mod masked;
mod max_pool;
pub mod metrics;
mod mse;
mod perceptual;
mod photometric;
mod pose;
mod quantile;
mod ranking;
mod relative_pose;
mod ssim;
mod ssim_window;

pub use budget::{global_budget, share_budget};
pub use color_map::ColorMap;
pub use depth::{masked_depth_mse, sparse_log_depth_l1};
pub use error_regression::{error_regression, error_target};
pub use lpips::Lpips;
pub use masked::{inside_of, masked_mse};
pub use max_pool::max_pool2d;
pub use mse::{mse, mse_per_image, weighted_mean};
pub use perceptual::Perceptual;
pub use photometric::{Photometric, PhotometricValue};
pub use pose::{absolute_pose, huber_pose, iteration_weights, l1_pose};
pub use quantile::quantiles;
pub use ranking::{frequency_targets, ranking_cross_entropy};
pub use relative_pose::{focal_error, rotation_angles};
pub use ssim::{masked_ssim, ssim, ssim_with, ssim_zero_padded};
pub use ssim_window::Covariance;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
