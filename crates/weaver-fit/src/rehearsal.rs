//! How many steps fit into a time.

use crate::FitError;
use crate::fit::Fit;
use std::time::Instant;
use weaver_splat::Rasterizer;

/// Steps of a rehearsal, at least and at most, and the part of the time that it may take in between.
const STEPS: (usize, usize) = (30, 200);
const PART: f64 = 0.04;

/// How many steps a fit can do in this many seconds, the rehearsal included, which leaves no trace in it. At least 1.
///
/// A short run with the same schedules is timed: photos are as small, and Gaussians as many, in the same parts of it as in a
/// long one. Adjusting all cameras at once, which happens as often in any run, is timed apart.
///
/// # Errors
/// As [`Fit::step`].
pub fn steps_in<R: Rasterizer<f32>>(fit: &mut Fit<R>, seconds: f64) -> Result<usize, FitError> {
    let start = Instant::now();
    let kept = (fit.population.clone(), fit.statistics.clone(), fit.exposures.clone(), fit.poses.clone(), fit.focal);
    let settings = fit.settings.clone();
    let result = timed(fit, seconds);
    (fit.population, fit.statistics, fit.exposures, fit.poses, fit.focal) = kept;
    (fit.settings, fit.step) = (settings, 0);
    let (step, once) = result?;
    let left = seconds - start.elapsed().as_secs_f64() - once;
    Ok(((left / step) as usize).max(1))
}

/// Mean seconds of a step, and those of what is done a fixed number of times.
fn timed<R: Rasterizer<f32>>(fit: &mut Fit<R>, seconds: f64) -> Result<(f64, f64), FitError> {
    let rounds = std::mem::take(&mut fit.settings.poses.rounds).len();
    let refined = fit.settings.poses.refine;
    // The first step meets cold memory.
    fit.step()?;
    let start = Instant::now();
    fit.step()?;
    let step = start.elapsed().as_secs_f64();
    let steps = ((PART * seconds / step.max(1e-6)) as usize).clamp(STEPS.0, STEPS.1);
    (fit.settings.steps, fit.step) = (steps, 0);
    let start = Instant::now();
    while fit.step < steps {
        fit.step()?;
    }
    let step = start.elapsed().as_secs_f64() / steps as f64;
    let start = Instant::now();
    if refined && rounds > 0 {
        fit.adjust(0)?;
    }
    Ok((step, rounds as f64 * start.elapsed().as_secs_f64()))
}
