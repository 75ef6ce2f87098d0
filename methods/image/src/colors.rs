//! Colors in closed form: least squares, for drawing is linear in them.

use crate::canvas::Canvas;
use crate::error::ImageError;
use crate::gaussians::Gaussians;
use crate::operator::Values;
use crate::picture::Picture;
use crate::rounding::{Grid, Parts};
use weaver_kernels::random::Stream;
use weaver_lift::{Descent, LiftError, LiftOptions, Maps, Solver, Stop, lift};

/// Rounds of color rounding, and steps of conjugate gradients after each.
const ROUNDS: usize = 6;
const STEPS: usize = 6;

/// Brings the colors of Gaussians nearer to the least squares against a picture, by `steps` steps of conjugate
/// gradients on `A^T A c = A^T B` from their present colors, preconditioned by `sum_p w_i(p)`. No step raises the
/// squared error.
///
/// # Errors
/// Gaussians that cannot be drawn.
pub fn solve_colors(
    picture: &Picture,
    gaussians: &mut Gaussians<f32>,
    cut: f64,
    steps: usize,
) -> Result<(), ImageError> {
    let all: Vec<usize> = (0..gaussians.len()).collect();
    solve_some(picture, gaussians, &all, cut, steps)
}

/// As [`solve_colors`], for some of the Gaussians; the others are constant.
fn solve_some(
    picture: &Picture,
    gaussians: &mut Gaussians<f32>,
    some: &[usize],
    cut: f64,
    steps: usize,
) -> Result<(), ImageError> {
    let mut canvas = Canvas::new();
    canvas.place(gaussians, picture.window(), cut)?;
    let mut residual = vec![0.0; picture.colors.len()];
    canvas.draw(&gaussians.colors, &mut residual)?;
    residual.iter_mut().zip(&picture.colors).for_each(|(drawn, color)| *drawn = color - *drawn);
    let mut values = Values::new(&gaussians.some(some), picture.window(), cut)?;
    let stop = Stop { passes: steps + 1, ..Stop::default() };
    let options = LiftOptions {
        solver: Solver::Exact { descent: Descent::ConjugateGradients, stop },
        least_alpha: None,
        ..LiftOptions::default()
    };
    let mut maps = Maps { views: vec![residual], channels: 3 };
    let change = match lift(&mut values, &mut maps, &options, &mut || ()) {
        // Unseen Gaussians may have any color.
        Err(LiftError::NothingSeen { .. }) => return Ok(()),
        lifted => lifted?.features,
    };
    for (i, change) in some.iter().zip(change.chunks_exact(3)) {
        gaussians.colors[3 * i..3 * i + 3].iter_mut().zip(change).for_each(|(color, change)| *color += change);
    }
    Ok(())
}

/// Rounds colors to a grid, a random sixth at a time; after each, the remaining ones are solved for again.
pub(crate) fn round_colors(
    picture: &Picture,
    gaussians: &mut Gaussians<f32>,
    grid: &Grid,
    cut: f64,
    seed: u64,
) -> Result<(), ImageError> {
    let order = Stream::new(seed, 0, "image.rounding").permutation(gaussians.len());
    let each = order.len().div_ceil(ROUNDS).max(1);
    for first in (0..order.len()).step_by(each) {
        let (now, later) = order[first..].split_at(each.min(order.len() - first));
        now.iter().for_each(|i| grid.round(gaussians, *i, Parts { color: true, ..Parts::default() }));
        if !later.is_empty() {
            solve_some(picture, gaussians, later, cut, STEPS)?;
        }
    }
    Ok(())
}
