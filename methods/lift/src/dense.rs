//! Weights in a matrix.

use crate::error::{LiftError, expect_len};
use crate::operator::Operator;
use weaver_kernels::Real;

/// A matrix of weights in memory: for tests, and for weights from elsewhere.
///
/// ```
/// use weaver_lift::{Dense, Operator};
/// let mut weights = Dense::new(vec![0.5, 0.25, 0.0, 1.0], 2, 1)?; // two pixels of one view, two Gaussians
/// let mut image = [0.0; 2];
/// weights.forward(0, &[2.0, 4.0], 1, &mut image)?;
/// assert_eq!(image, [2.0, 4.0]);
/// # Ok::<(), weaver_lift::LiftError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Dense<T> {
    weights: Vec<T>,
    splats: usize,
    views: usize,
}

impl<T: Real> Dense<T> {
    /// `weights` is `[R, P]` with R a multiple of `views`.
    ///
    /// # Errors
    /// [`LiftError::Length`] if the weights cannot be cut into this number of views of whole rows.
    pub fn new(weights: Vec<T>, splats: usize, views: usize) -> Result<Self, LiftError> {
        let unit = (splats * views).max(1);
        expect_len("weights", weights.len(), weights.len() / unit * unit)?;
        Ok(Self { weights, splats, views })
    }

    /// The rows of a view.
    fn rows(&self, view: usize) -> impl Iterator<Item = &[T]> {
        let rays = self.rays(view);
        self.weights[view * rays * self.splats..][..rays * self.splats].chunks_exact(self.splats.max(1))
    }

    fn gather(&self, view: usize, y: &[T], x: &mut [T], weight: impl Fn(T) -> T) -> Result<(), LiftError> {
        let channels = y.len() / self.rays(view).max(1);
        expect_len("features of Gaussians", x.len(), self.splats * channels)?;
        for (row, y) in self.rows(view).zip(y.chunks_exact(channels.max(1))) {
            for (&a, x) in row.iter().zip(x.chunks_exact_mut(channels.max(1))) {
                x.iter_mut().zip(y).for_each(|(x, y)| *x += weight(a) * *y);
            }
        }
        Ok(())
    }
}

impl<T: Real> Operator<T> for Dense<T> {
    fn splats(&self) -> usize {
        self.splats
    }

    fn views(&self) -> usize {
        self.views
    }

    fn rays(&self, _view: usize) -> usize {
        self.weights.len() / (self.splats * self.views).max(1)
    }

    fn forward(&mut self, view: usize, x: &[T], channels: usize, y: &mut [T]) -> Result<(), LiftError> {
        expect_len("features of Gaussians", x.len(), self.splats * channels)?;
        expect_len("features of pixels", y.len(), self.rays(view) * channels)?;
        y.fill(T::ZERO);
        for (row, y) in self.rows(view).zip(y.chunks_exact_mut(channels.max(1))) {
            for (&a, x) in row.iter().zip(x.chunks_exact(channels.max(1))) {
                y.iter_mut().zip(x).for_each(|(y, x)| *y += a * *x);
            }
        }
        Ok(())
    }

    fn adjoint(&mut self, view: usize, y: &[T], channels: usize, x: &mut [T]) -> Result<(), LiftError> {
        expect_len("features of pixels", y.len(), self.rays(view) * channels)?;
        self.gather(view, y, x, |a| a)
    }

    fn adjoint_squared(&mut self, view: usize, y: &[T], channels: usize, x: &mut [T]) -> Result<(), LiftError> {
        expect_len("features of pixels", y.len(), self.rays(view) * channels)?;
        self.gather(view, y, x, |a| a * a)
    }
}
