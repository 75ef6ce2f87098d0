//! The linear map from features of Gaussians to features of pixels.

use crate::error::LiftError;
use weaver_kernels::Real;

/// The matrix A `[R, P]` of compositing weights: `A_ij` is alpha T of Gaussian j at pixel i, not negative, with row
/// sums of at most 1. Its rows come view by view, so that no more than one view's pixels are in memory.
///
/// Implemented by the rasterizer, [`Raster`](crate::Raster), and by a matrix, [`Dense`](crate::Dense). With `Y = A X`,
/// `forward` is drawing and `adjoint` the gradient of drawing with respect to features.
pub trait Operator<T: Real> {
    /// P, the number of Gaussians.
    fn splats(&self) -> usize;

    /// Number of views.
    fn views(&self) -> usize;

    /// Pixels of a view.
    fn rays(&self, view: usize) -> usize;

    /// `y = A_v x`: overwrites `y` `[R_v, channels]`, from `x` `[P, channels]`.
    ///
    /// # Errors
    /// Lengths that do not fit, or errors of drawing.
    fn forward(&mut self, view: usize, x: &[T], channels: usize, y: &mut [T]) -> Result<(), LiftError>;

    /// `x += A_v^T y`: adds to `x` `[P, channels]`, from `y` `[R_v, channels]`.
    ///
    /// # Errors
    /// As [`forward`](Self::forward).
    fn adjoint(&mut self, view: usize, y: &[T], channels: usize, x: &mut [T]) -> Result<(), LiftError>;

    /// `x_j += sum_i A_ij^2 y_i`: as [`adjoint`](Self::adjoint), by squared weights.
    ///
    /// # Errors
    /// As [`forward`](Self::forward).
    fn adjoint_squared(&mut self, view: usize, y: &[T], channels: usize, x: &mut [T]) -> Result<(), LiftError>;
}
