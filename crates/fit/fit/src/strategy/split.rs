//! Splitting along the longest axis, guided by absolute screen gradients.

use super::{Density, Moment, Regularizer, Strategy};
use crate::population::Population;
use weaver_splat::GaussianStatistics;

/// Splits the Gaussians that are pulled apart hardest, and lets opacities decay so that superfluous Gaussians fade
/// away.
///
/// In every round, opacities lose a constant, Gaussians that have become transparent are removed, and those with the
/// largest absolute screen gradient per view are split in two along their longest axis: halves stand half a standard
/// deviation to either side with 0.6 of the deviation, and together are as opaque as before, `1 - sqrt(1 - o)` each.
/// The number of Gaussians grows evenly toward the budget over the rounds; later, splits replace the faded ones.
///
/// Sources: AbsGS (Ye et al., 2024) for the gradient, Brush for decay and opacities of halves.
#[derive(Clone, Debug)]
pub struct Split {
    settings: Density,
}

/// Standard deviations between the middle of a Gaussian and its halves. This, the shrinking and the schedule of growth
/// were varied one at a time, and gained less than 0.15 dB.
const OFFSET: f32 = 0.5;
/// Logarithm of the shrinking of the split axis, to 0.6.
const SHRINK: f32 = -0.51;

/// Part of the rounds after which all room is used; the others only replace faded Gaussians.
const GROWING: f64 = 0.75;

impl Split {
    /// The strategy with these settings.
    pub fn new(settings: Density) -> Self {
        Self { settings }
    }

    /// Number of Gaussians after the round at this moment: as many more as in each that is left to grow in.
    fn wanted(&self, moment: &Moment, now: usize) -> usize {
        let Density { from, until, .. } = self.settings;
        let left = (from + GROWING * (until - from) - moment.fraction()) * moment.steps as f64;
        let rounds = (left / self.settings.interval(moment.steps) as f64).max(0.0);
        let missing = moment.budget.saturating_sub(now) as f64;
        now + (missing / (rounds + 1.0)).ceil() as usize
    }

    fn fade(&self, population: &mut Population) {
        for n in 0..population.len() {
            let opacity = population.opacity(n) - self.settings.opacity_decay;
            population.set_opacity(n, opacity);
        }
    }
}

impl Strategy for Split {
    fn regularizer(&self, moment: &Moment, gaussians: usize) -> Regularizer {
        self.settings.regularizer(moment, gaussians)
    }

    fn wants_statistics(&self, moment: &Moment) -> bool {
        moment.fraction() <= self.settings.until
    }

    fn is_due(&self, moment: &Moment) -> bool {
        self.settings.due(moment)
    }

    fn adapt(&mut self, moment: &Moment, population: &mut Population, statistics: &[GaussianStatistics<f32>]) -> bool {
        if !self.is_due(moment) {
            return false;
        }
        self.fade(population);
        let mut scores: Vec<f32> = statistics.iter().map(|s| s.absgrad / s.views.max(1) as f32).collect();
        let keep: Vec<bool> =
            (0..population.len()).map(|n| population.opacity(n) >= self.settings.least_opacity).collect();
        let mut kept = keep.iter();
        scores.retain(|_| *kept.next().unwrap_or(&true));
        population.retain(&keep);
        let more = self.wanted(moment, population.len()).min(moment.budget).saturating_sub(population.len());
        for n in largest(&scores, more) {
            split(population, n);
        }
        true
    }
}

/// The indices of the `count` largest positive scores, in ascending order; ties by index.
fn largest(scores: &[f32], count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..scores.len()).filter(|&n| scores[n] > 0.0).collect();
    if order.len() > count {
        order.select_nth_unstable_by(count, |&a, &b| scores[b].total_cmp(&scores[a]).then(a.cmp(&b)));
        order.truncate(count);
    }
    order.sort_unstable();
    order
}

/// Replaces a Gaussian by two halves of it.
pub(crate) fn split(population: &mut Population, n: usize) {
    let scales = population.log_scales.row(n);
    let longest = (0..3).fold(0, |best, i| if scales[i] > scales[best] { i } else { best });
    let axis = population.axes(n)[longest];
    let offset = OFFSET * scales[longest].exp();
    population.log_scales.row_mut(n)[longest] += SHRINK;
    let opacity = 1.0 - (1.0 - population.opacity(n)).max(0.0).sqrt();
    population.set_opacity(n, opacity);
    population.forget(n);
    let other = population.duplicate(n);
    for (i, along) in axis.into_iter().enumerate() {
        population.means.row_mut(n)[i] += offset * along;
        population.means.row_mut(other)[i] -= offset * along;
    }
}
