//! How many steps fit into a time.

use crate::FitError;
use crate::fit::Fit;
use std::time::Instant;

/// Steps of the run that is timed, at least and at most, and the part of the time that it may take in between.
const STEPS: (usize, usize) = (30, 3000);
const PART: f64 = 0.05;
/// A run of no more than this times the least is not worth a second one.
const ENOUGH: usize = 2;
/// Part of the time that is left over, for no machine is equally fast all the time.
const RESERVE: f64 = 0.04;

/// Number of steps that a fit can do in so many seconds, the timed run included, which leaves no trace in it. At least 1.
///
/// # Errors
/// As [`Fit::step`].
pub fn steps_in(fit: &mut Fit, seconds: f64) -> Result<usize, FitError> {
    let start = Instant::now();
    let step = step_seconds(fit, PART * seconds)?;
    let left = (1.0 - RESERVE) * seconds - start.elapsed().as_secs_f64();
    // All processes make the steps that the first one has time for.
    Ok(fit.agreed((left / step) as usize).max(1))
}

/// Mean seconds of a step, by a short run of about so many seconds, 30 to 3000 steps, which leaves no trace.
///
/// It has the same schedules: photos are as small, and Gaussians as many, in the same parts of it as in a long one.
///
/// # Errors
/// As [`Fit::step`].
pub fn step_seconds(fit: &mut Fit, seconds: f64) -> Result<f64, FitError> {
    fit.fetch()?;
    // The first steps of a run are much shorter than those after them: only a whole run, if a short one, tells how many take the time.
    let step = rehearsed(fit, STEPS.0)?;
    let steps = fit.agreed((seconds / step.max(1e-6)) as usize).min(STEPS.1);
    if steps > ENOUGH * STEPS.0 { rehearsed(fit, steps) } else { Ok(step) }
}

/// Mean seconds of a step of a run of so many, which leaves no trace.
fn rehearsed(fit: &mut Fit, steps: usize) -> Result<f64, FitError> {
    let kept = (fit.population.clone(), fit.statistics.clone());
    let of_photos = (fit.exposures.clone(), fit.poses.clone(), fit.transients.clone());
    let settings = fit.settings.clone();
    let result = timed(fit, steps);
    (fit.population, fit.statistics) = kept;
    (fit.exposures, fit.poses, fit.transients) = of_photos;
    (fit.settings, fit.step) = (settings, 0);
    fit.changed();
    result
}

/// Mean seconds of a step of a run of so many.
fn timed(fit: &mut Fit, steps: usize) -> Result<f64, FitError> {
    // The first step meets cold memory.
    fit.step()?;
    (fit.settings.steps, fit.step) = (steps, 0);
    let start = Instant::now();
    while fit.step < steps {
        fit.step()?;
    }
    Ok(start.elapsed().as_secs_f64() / steps as f64)
}
