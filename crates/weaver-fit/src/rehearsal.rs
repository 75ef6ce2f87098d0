//! How many steps fit into a time.

use crate::FitError;
use crate::fit::Fit;
use std::time::Instant;
use weaver_kernels::random::Stream;
use weaver_splat::Rasterizer;

/// Steps of each kind that are timed; the first of a kind, which meets cold memory, is not counted.
const TIMED: usize = 4;
/// Parts of a run whose cost is looked at.
const PARTS: usize = 50;

/// How many steps a fit can do in this many seconds, from steps that are timed now and leave no trace in it.
///
/// Timed are steps at each size of the photos, with the initial number of Gaussians and with all of the budget; in between
/// the time is taken to grow with the number, as in the run. At least 1.
///
/// # Errors
/// As [`Fit::step`].
pub fn steps_in<R: Rasterizer<f32>>(fit: &mut Fit<R>, seconds: f64) -> Result<usize, FitError> {
    let kept = (fit.population.clone(), fit.statistics.clone(), fit.exposures.clone(), fit.poses.clone(), fit.focal);
    let result = mean_seconds(fit);
    (fit.population, fit.statistics, fit.exposures, fit.poses, fit.focal) = kept;
    Ok(((seconds / result?) as usize).max(1))
}

fn mean_seconds<R: Rasterizer<f32>>(fit: &mut Fit<R>) -> Result<f64, FitError> {
    let settings = fit.settings().clone();
    let (initial, budget) = (fit.population().len(), settings.gaussians);
    let levels = if settings.coarse_until > 0.0 { settings.halvings } else { 0 };
    fit.population.raise_degree(settings.sh_degree);
    let few: Vec<f64> = (0..=levels).map(|level| timed(fit, level)).collect::<Result<_, _>>()?;
    let grows = settings.density.strategy != crate::StrategyKind::Keep;
    if grows {
        grow(fit, budget);
    }
    let many: Vec<f64> = (0..=levels).map(|level| timed(fit, level)).collect::<Result<_, _>>()?;
    let part = |i: usize| {
        let fraction = (i as f64 + 0.5) / PARTS as f64;
        let level = settings.level(fraction);
        let full = settings.density.from + 0.75 * (settings.density.until - settings.density.from);
        let grown = if grows && initial < budget { (fraction / full.max(1e-9)).min(1.0) } else { 0.0 };
        few[level] + grown * (many[level] - few[level])
    };
    Ok((0..PARTS).map(part).sum::<f64>() / PARTS as f64)
}

/// Mean seconds of a step at a size of the photos.
fn timed<R: Rasterizer<f32>>(fit: &mut Fit<R>, level: usize) -> Result<f64, FitError> {
    let photos = fit.photos();
    let mut start = Instant::now();
    for i in 0..=TIMED {
        if i == 1 {
            start = Instant::now();
        }
        fit.rehearse(i * photos / (TIMED + 1), level)?;
    }
    Ok(start.elapsed().as_secs_f64() / TIMED as f64)
}

/// Fills the population up to a number by halving random Gaussians.
fn grow<R: Rasterizer<f32>>(fit: &mut Fit<R>, number: usize) {
    let stream = Stream::new(0, 0, "fit.rehearsal");
    let mut drawn = 0;
    while fit.population.len() < number {
        let n = stream.below(drawn, fit.population.len());
        crate::strategy::split(&mut fit.population, n);
        drawn += 1;
    }
}
