//! Tests of the losses and metrics.

mod gradients;
mod lpips;
mod lpips_twin;
mod masked;
mod mechanism;
mod metrics;
mod parity;
mod perceptual;
mod photometric;
mod shapes;
mod ssim;
mod surfaces;
mod weights;
