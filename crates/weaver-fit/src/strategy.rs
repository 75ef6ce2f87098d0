//! Density control: which Gaussians are added, removed and moved, and when.

mod keep;
mod mcmc;
mod split;

pub use keep::Keep;
pub use mcmc::{Mcmc, relocated};
pub use split::Split;
pub(crate) use split::split;

use crate::gradients::Gradients;
use crate::population::Population;
use crate::settings::{Density, StrategyKind};
use std::fmt::Debug;
use weaver_kernels::random::Stream;
use weaver_splat::GaussianStatistics;

/// Where in a run a strategy is asked.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// Steps done.
    pub step: usize,
    /// Steps of the whole run.
    pub steps: usize,
    /// The most Gaussians there may be.
    pub budget: usize,
    /// Learning rate of the means at this step, world units.
    pub mean_rate: f32,
    /// Size of the scene, world units.
    pub extent: f32,
    /// Random numbers for this step.
    pub stream: Stream,
}

impl Moment {
    /// The part of the run that is done.
    pub fn fraction(&self) -> f64 {
        self.step as f64 / self.steps.max(1) as f64
    }
}

/// A way to control density.
///
/// A strategy never makes more Gaussians than [`Moment::budget`]. It is a function of what it is given: a run that is resumed
/// goes on with a new strategy of the same settings.
pub trait Strategy: Debug + Send {
    /// Adds the gradients of regularizers, before a step.
    fn regularize(&self, _moment: &Moment, _population: &Population, _gradients: &mut Gradients) {}

    /// Whether the statistics of backward passes are wanted at this moment; they cost a little.
    fn wants_statistics(&self, moment: &Moment) -> bool;

    /// Changes the Gaussians after a step, and returns whether any was added, removed or moved; statistics, which are
    /// sums since the last such change, then begin anew.
    fn adapt(&mut self, moment: &Moment, population: &mut Population, statistics: &[GaussianStatistics<f32>]) -> bool;
}

impl Density {
    /// The strategy of these settings.
    pub fn strategy(&self) -> Box<dyn Strategy> {
        match self.strategy {
            StrategyKind::Split => Box::new(Split::new(self.clone())),
            StrategyKind::Mcmc => Box::new(Mcmc::new(self.clone())),
            StrategyKind::Keep => Box::new(Keep),
        }
    }

    /// Adds the gradients of `opacity_weight mean(opacity) + scale_weight mean(scale) / extent`.
    fn regularize(&self, moment: &Moment, population: &Population, gradients: &mut Gradients) {
        let n = population.len() as f32;
        let (by_opacity, by_scale) = (self.opacity_weight / n, self.scale_weight / (3.0 * n * moment.extent));
        gradients.opacities.iter_mut().for_each(|g| *g += by_opacity);
        gradients.scales.iter_mut().for_each(|g| *g += by_scale);
    }

    /// Steps between two rounds of a run of so many steps.
    pub(crate) fn interval(&self, steps: usize) -> usize {
        (steps / self.rounds.max(1)).max(1)
    }

    /// Whether a round is due at this moment.
    pub(crate) fn due(&self, moment: &Moment) -> bool {
        let done = moment.fraction();
        let due = moment.step > 0 && moment.step.is_multiple_of(self.interval(moment.steps));
        due && done >= self.from && done <= self.until
    }
}
