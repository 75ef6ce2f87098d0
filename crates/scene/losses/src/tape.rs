//! Losses on the tape.

mod budget;
mod depth;
mod error_regression;
mod feature_distance;
pub mod lpips;
mod masked;
mod max_pool;
mod mse;
mod perceptual;
mod pose;
mod quantiles;
mod ranking;
mod relative_pose;
mod ssim;

pub use budget::{global_budget, share_budget};
pub use depth::{laplacian_log_depth, masked_depth_mse, sparse_log_depth_l1};
pub use error_regression::{error_regression, error_target};
pub use lpips::Lpips;
pub use masked::{inside_of, masked_mse};
pub use max_pool::max_pool2d;
pub use mse::mse;
pub use perceptual::Perceptual;
pub use pose::{absolute_pose, huber_pose, iteration_weights, l1_pose};
pub use quantiles::quantiles;
pub use ranking::{frequency_targets, ranking_cross_entropy};
pub use relative_pose::{focal_error, rotation_angles};
pub use ssim::{masked_ssim, ssim, ssim_with, ssim_zero_padded};
