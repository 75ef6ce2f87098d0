//! Drawing as a linear map from colors to pixels, for the solvers of weaver-lift.

use crate::canvas::Canvas;
use crate::error::ImageError;
use crate::gaussians::Gaussians;
use crate::window::Window;
use weaver_kernels::Real;
use weaver_lift::{LiftError, Operator};

/// The values of Gaussians at the pixels of a window, `A_pi = w_i(p)`, as an [`Operator`] with one view.
#[derive(Clone, Debug)]
pub struct Values<T> {
    window: Window,
    canvas: Canvas<T>,
    /// The canvas of the squares of all values.
    squares: Canvas<T>,
}

impl<T: Real> Values<T> {
    /// The values of these Gaussians in a window, up to `cut` standard deviations.
    ///
    /// # Errors
    /// As [`Canvas::place`].
    pub fn new(gaussians: &Gaussians<T>, window: Window, cut: f64) -> Result<Self, ImageError> {
        let (mut canvas, mut squares) = (Canvas::new(), Canvas::new());
        canvas.place(gaussians, window, cut)?;
        // The square of a Gaussian is one with half the variance and the same cut.
        let narrow = T::from_f64(0.5_f64.sqrt());
        let mut half = gaussians.clone();
        half.scales.iter_mut().for_each(|s| *s *= narrow);
        squares.place(&half, window, cut * 2.0_f64.sqrt())?;
        Ok(Self { window, canvas, squares })
    }
}

/// One channel of `[N, channels]`.
fn channel<T: Real>(of: &[T], channel: usize, channels: usize) -> Vec<T> {
    of.iter().skip(channel).step_by(channels).copied().collect()
}

/// Runs `body(from, to)` on one channel at a time, or on all if there are one or three.
fn by_channel<T: Real>(
    from: &[T],
    to: &mut [T],
    channels: usize,
    mut body: impl FnMut(&[T], &mut [T]) -> Result<(), ImageError>,
) -> Result<(), LiftError> {
    let source = |error: ImageError| LiftError::Source(Box::new(error));
    if channels == 3 || channels == 1 {
        return body(from, to).map_err(source);
    }
    for c in 0..channels {
        let mut out = channel(to, c, channels);
        body(&channel(from, c, channels), &mut out).map_err(source)?;
        to.iter_mut().skip(c).step_by(channels).zip(out).for_each(|(to, x)| *to = x);
    }
    Ok(())
}

impl<T: Real> Operator<T> for Values<T> {
    fn splats(&self) -> usize {
        self.canvas.len()
    }

    fn views(&self) -> usize {
        1
    }

    fn rays(&self, _view: usize) -> usize {
        self.window.pixels()
    }

    fn forward(&mut self, _view: usize, x: &[T], channels: usize, y: &mut [T]) -> Result<(), LiftError> {
        by_channel(x, y, channels, |x, y| self.canvas.draw(x, y))
    }

    fn adjoint(&mut self, _view: usize, y: &[T], channels: usize, x: &mut [T]) -> Result<(), LiftError> {
        by_channel(y, x, channels, |y, x| self.canvas.transposed(y, x))
    }

    fn adjoint_squared(&mut self, _view: usize, y: &[T], channels: usize, x: &mut [T]) -> Result<(), LiftError> {
        by_channel(y, x, channels, |y, x| self.squares.transposed(y, x))
    }
}
