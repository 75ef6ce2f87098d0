//! Training with quantization: rounded Gaussians are drawn, unrounded ones optimized.

use std::error::Error;
use std::fmt::Debug;
use weaver_scene::Gaussians;

/// A map from the Gaussians that are optimized to those that are drawn in their place.
///
/// Gradients with respect to the rounded Gaussians are applied to the unrounded ones (the straight-through estimator;
/// Bengio et al., 2013), so that the optimizer finds Gaussians whose rounded forms look right.
/// [`Fit::set_rounding`](crate::Fit::set_rounding) takes one.
pub trait Rounding: Debug + Send {
    /// As many Gaussians of the same degree in the same order.
    ///
    /// # Errors
    /// Gaussians that cannot be rounded.
    fn rounded(&mut self, gaussians: &Gaussians) -> Result<Gaussians, Box<dyn Error + Send + Sync>>;

    /// Least cost of removing a Gaussian that stays, over the mean error that rounding gives one, both as [squared
    /// changes of pictures](crate::Fit::removal_costs): where less is lost, bits are better spent on the others. At 0,
    /// the default, all stay.
    fn worth(&self) -> f64 {
        0.0
    }
}
