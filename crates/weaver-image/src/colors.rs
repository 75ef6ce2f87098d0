//! Colors in closed form: least squares, for drawing is linear in them.

use crate::canvas::Canvas;
use crate::error::ImageError;
use crate::gaussians::Gaussians;
use crate::operator::Values;
use crate::picture::Picture;
use weaver_lift::{Descent, LiftOptions, Maps, Solver, Stop, lift};

/// Brings the colors of Gaussians nearer to the least squares against a picture, by `steps` steps of conjugate gradients on
/// `A^T A c = A^T B` from the colors they have, preconditioned by `sum_p w_i(p)`. No step raises the squared error.
///
/// # Errors
/// Gaussians that cannot be drawn, or none over the picture.
pub fn solve_colors(
    picture: &Picture,
    gaussians: &mut Gaussians<f32>,
    cut: f64,
    steps: usize,
) -> Result<(), ImageError> {
    let mut canvas = Canvas::new();
    canvas.place(gaussians, picture.window(), cut)?;
    let mut residual = vec![0.0; picture.colors.len()];
    canvas.draw(&gaussians.colors, &mut residual)?;
    residual.iter_mut().zip(&picture.colors).for_each(|(drawn, color)| *drawn = color - *drawn);
    let mut values = Values::new(gaussians, picture.window(), cut)?;
    let stop = Stop { passes: steps + 1, ..Stop::default() };
    let options = LiftOptions {
        solver: Solver::Exact { descent: Descent::ConjugateGradients, stop },
        least_alpha: None,
        ..LiftOptions::default()
    };
    let mut maps = Maps { views: vec![residual], channels: 3 };
    let change = lift(&mut values, &mut maps, &options, &mut || ())?.features;
    gaussians.colors.iter_mut().zip(change).for_each(|(color, change)| *color += change);
    Ok(())
}
