//! Density control: adding, removing and moving Gaussians.

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

/// The moment of a run at which a strategy acts.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// Steps done.
    pub step: usize,
    /// The first of the numbers of steps that this moment stands for: `step` itself, but where steps before it were
    /// [left out](crate::Thinning).
    pub since: usize,
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

    /// The multiple of `interval` that this moment stands for, if there is one: the latest of several.
    pub fn multiple_of(&self, interval: usize) -> Option<usize> {
        let multiple = self.step / interval.max(1) * interval.max(1);
        (multiple >= self.since).then_some(multiple)
    }
}

/// Regularizers: a sum over the Gaussians of these multiples of the opacity, and of each of the three scales.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Regularizer {
    /// Weight of the opacity.
    pub opacity: f32,
    /// Weight of a standard deviation.
    pub scale: f32,
}

impl Regularizer {
    /// Adds the gradients.
    pub(crate) fn add(self, gradients: &mut Gradients) {
        gradients.opacities.iter_mut().for_each(|g| *g += self.opacity);
        gradients.scales.iter_mut().for_each(|g| *g += self.scale);
    }
}

/// A way to control density.
///
/// A strategy never makes more Gaussians than [`Moment::budget`]. It is a function of its arguments: a run that is
/// resumed goes on with a new strategy of the same settings.
pub trait Strategy: Debug + Send {
    /// Regularizer added to the loss of a step with so many Gaussians.
    fn regularizer(&self, _moment: &Moment, _gaussians: usize) -> Regularizer {
        Regularizer::default()
    }

    /// True if the statistics of backward passes are wanted at this moment; they cost a little.
    fn wants_statistics(&self, moment: &Moment) -> bool;

    /// True if [`adapt`](Self::adapt) may change anything at this moment; where it says no, it is not called, and a
    /// device keeps the Gaussians.
    fn is_due(&self, _moment: &Moment) -> bool {
        true
    }

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

    /// `opacity_weight mean(opacity) + scale_weight mean(scale) / extent`.
    fn regularizer(&self, moment: &Moment, gaussians: usize) -> Regularizer {
        let n = gaussians as f32;
        Regularizer { opacity: self.opacity_weight / n, scale: self.scale_weight / (3.0 * n * moment.extent) }
    }

    /// Steps between two rounds of a run of so many steps.
    pub(crate) fn interval(&self, steps: usize) -> usize {
        (steps / self.rounds.max(1)).max(1)
    }

    /// True if a round is due at this moment.
    pub(crate) fn due(&self, moment: &Moment) -> bool {
        let Some(step) = moment.multiple_of(self.interval(moment.steps)) else { return false };
        let done = step as f64 / moment.steps.max(1) as f64;
        step > 0 && done >= self.from && done <= self.until
    }
}
