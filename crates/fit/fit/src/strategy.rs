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
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt::Debug;
use weaver_kernels::random::Stream;
use weaver_splat::GaussianStatistics;

/// Photos up to which opacities are pulled down by the usual weight: with 12 and 17 less weight lost 0.1 dB, with 43
/// and more none gained 0.2 to 0.5.
const FADED: f32 = 20.0;

/// Settings of adding, removing and moving Gaussians.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Density {
    /// The strategy.
    pub strategy: StrategyKind,
    /// Rounds that a run has room for, evenly spread; those before `from` and after `until` are left out.
    pub rounds: usize,
    /// Part of the run before the first round.
    pub from: f64,
    /// Part of the run after which the number of Gaussians stays.
    pub until: f64,
    /// Gaussians with a lower opacity are given up.
    pub least_opacity: f32,
    /// Amount that every round takes off all opacities (`split`), so that unneeded Gaussians fade.
    pub opacity_decay: f32,
    /// Part of the budget that initial Gaussians may fill.
    pub initial_part: f64,
    /// Growth per round toward the budget (`mcmc`).
    pub growth: f64,
    /// Noise on the means over their learning rate, by covariances in units of the scene's size (`mcmc`).
    pub noise: f64,
    /// Weight of the mean opacity in the loss, so that what is not needed fades.
    pub opacity_weight: f32,
    /// Weight of the mean scale over the scene's size in the loss.
    pub scale_weight: f32,
}

impl Default for Density {
    fn default() -> Self {
        Self {
            strategy: StrategyKind::Split,
            rounds: 30,
            from: 0.02,
            until: 0.8,
            least_opacity: 0.005,
            opacity_decay: 0.004,
            initial_part: 0.6,
            growth: 0.05,
            noise: 5e6,
            opacity_weight: 0.003,
            scale_weight: 0.0,
        }
    }
}

/// Where in a run a strategy is asked.
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

/// Defines the strategies by kind, name in settings and flags, a line of help, and constructor.
macro_rules! strategies {
    ($($(#[$doc:meta])+ $kind:ident, $name:literal, $help:literal, $new:expr;)+) => {
        /// The strategies that come with this crate.
        #[derive(Clone, Copy, Debug, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
        pub enum StrategyKind {
            $($(#[$doc])+ #[serde(rename = $name)] $kind,)+
        }

        impl StrategyKind {
            /// All strategies: name, kind, and a line of help.
            pub const ALL: &[(&str, Self, &str)] = &[$(($name, Self::$kind, $help)),+];
        }

        impl Density {
            /// The strategy of these settings.
            pub fn strategy(&self) -> Box<dyn Strategy> {
                match self.strategy {
                    $(StrategyKind::$kind => Box::new($new(self.clone())),)+
                }
            }
        }
    };
}

strategies! {
    /// Splits what pulls hardest on the screen along its longest axis; opacities decay, what fades is removed.
    Split, "split", "Splits what pulls hardest on the screen; the rest fades", Split::new;
    /// 3DGS-MCMC: dead Gaussians move to live ones, noise explores.
    Mcmc, "mcmc", "3DGS-MCMC: relocation and noise", Mcmc::new;
    /// The number of Gaussians stays as it is.
    Keep, "keep", "The number stays as it is", |_| Keep;
}

impl Density {
    /// [`opacity_weight`](Self::opacity_weight) that pays for so many photos. Every step pulls all opacities down, and
    /// a photo pulls those up that it sees: the more photos there are, the more steps pass between two that see a
    /// place.
    ///
    /// ```
    /// use weaver_fit::Density;
    /// assert_eq!(Density::opacity_weight_for(20), Density::default().opacity_weight);
    /// assert!(Density::opacity_weight_for(40) < 0.0004);
    /// ```
    pub fn opacity_weight_for(photos: usize) -> f32 {
        let over = (FADED / photos.max(1) as f32).min(1.0);
        Self::default().opacity_weight * over.powi(3)
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
