//! Allocation by score: the highest-scoring pixels of a scene get one Gaussian each, in an exact number.

use super::{Allocation, AllocationRequest, Assignment, Fixed, bayer};
use weaver_autograd::Real;

/// floor(budget P), the number of pixels that a budget of Gaussians per pixel keeps, of P that count.
fn kept<T: Real>(budget: f64, request: &AllocationRequest<'_, T>) -> usize {
    let pixels = request.pixels_inside();
    ((budget * pixels as f64).floor() as usize).min(pixels)
}

/// Gives expert 1 to the `count` pixels of highest score over all views, the lower index first among equal scores.
fn keep_highest<T: Real>(
    request: &AllocationRequest<'_, T>,
    count: usize,
    score: impl Fn(Place) -> f64,
) -> Assignment<T> {
    let pixels = request.pixels();
    let mut expert = request.pool.filled(pixels, 0);
    let mut scores = request.pool.buffer::<f64>(pixels);
    scores.iter_mut().zip(request.places()).for_each(|(s, at)| *s = score(at));
    for (score, inside) in scores.iter_mut().zip(request.inside.into_iter().flatten()) {
        if !inside {
            // Behind all others, which are at least as many as are kept.
            *score = f64::NEG_INFINITY;
        }
    }
    let mut order = request.pool.buffer::<u32>(pixels);
    order.iter_mut().zip(0..).for_each(|(o, pixel)| *o = pixel);
    if count > 0 && count < pixels {
        order.select_nth_unstable_by(count - 1, |&a, &b| {
            scores[b as usize].total_cmp(&scores[a as usize]).then(a.cmp(&b))
        });
    }
    for &pixel in &order[..count] {
        expert[pixel as usize] = 1;
    }
    Assignment::plain(expert)
}

/// A pixel and where it is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// Index in (view, row, column) order.
    pub pixel: usize,
    /// Its view.
    pub view: usize,
    /// Its row.
    pub row: usize,
    /// Its column.
    pub column: usize,
}

/// Ordered dithering of the router's preference: the floor(budget P) pixels of highest score over all views get one
/// Gaussian.
///
/// The score is gamma (l_1 - l_0) - ln b, where b is the threshold of an 8 x 8 Bayer matrix, shifted from view to view.
/// The result is deterministic and the count exact. Where the logits are equal the chosen pixels form a regular grid;
/// elsewhere their density follows exp(gamma (l_1 - l_0)) without large holes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dithered {
    /// Gaussians per pixel, 0 to 1.
    pub budget: f64,
    /// Weight of the router in the density: 0 is none, 1 is in proportion to its odds.
    pub gamma: f64,
}

impl<T: Real> Allocation<T> for Dithered {
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T> {
        let experts = request.experts();
        keep_highest(request, kept(self.budget, request), |at| {
            let threshold = bayer::threshold(at.row, at.column, bayer::view_shift(at.view));
            let preference = if self.gamma == 0.0 {
                0.0
            } else {
                let logits = &request.logits[at.pixel * experts..];
                self.gamma * (logits[1].to_f64() - logits[0].to_f64())
            };
            preference - threshold.ln()
        })
    }
}

/// Spreads the budget on a regular grid, against any preference of the router: [`Dithered`] with gamma 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Gaussians per pixel, 0 to 1.
    pub budget: f64,
}

impl<T: Real> Allocation<T> for Grid {
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T> {
        Dithered { budget: self.budget, gamma: 0.0 }.allocate(request)
    }
}

/// Gives one Gaussian each to exactly floor(budget P) pixels, drawn uniformly from the request's stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Random {
    /// Gaussians per pixel, 0 to 1.
    pub budget: f64,
}

impl<T: Real> Allocation<T> for Random {
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T> {
        let count = kept(self.budget, request);
        keep_highest(request, count, |at| request.stream.uniform(at.pixel as u64))
    }
}

/// The allocation of training: each step draws a budget, a dependence on the energy, and a pattern.
///
/// The budget is one of `budgets`. The score is gamma ln(energy + 0.02) - ln(threshold), with gamma 0 in the share
/// `uniform` of the steps and otherwise uniform between 0 and `strongest`. Thresholds are noise in half of the steps,
/// and in the other half the Bayer matrix at one random shift for all views; noise of a millionth breaks ties. The
/// pixels of highest score get one Gaussian. A model trained in this way accepts any budget and density at test time,
/// and has trained all its experts.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingMix {
    /// Budgets in Gaussians per pixel; each step draws one.
    pub budgets: Vec<f64>,
    /// Share of the steps that ignore the energy, 0 to 1.
    pub uniform: f64,
    /// Largest exponent of the energy.
    pub strongest: f64,
    /// Share of the steps in which all pixels have as many Gaussians, 1 to M.
    pub dense: f64,
}

impl Default for TrainingMix {
    /// Budgets of 25, 40, 40 and 70 %; gamma 0 in 30 % of the steps, otherwise up to 1.3; every pixel in one step of
    /// sixteen.
    fn default() -> Self {
        Self { budgets: vec![0.25, 0.4, 0.4, 0.7], uniform: 0.3, strongest: 1.3, dense: 1.0 / 16.0 }
    }
}

impl<T: Real> Allocation<T> for TrainingMix {
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T> {
        let [step, noise, ties] = [0, 1, 2].map(|purpose| request.stream.fork(purpose));
        if step.uniform::<f64>(6) < self.dense {
            return Fixed { expert: 1 + step.below(7, request.experts() - 1) as u8 }.allocate(request);
        }
        let budget = self.budgets[step.below(0, self.budgets.len())];
        let gamma = if step.uniform::<f64>(1) < self.uniform { 0.0 } else { self.strongest * step.uniform::<f64>(2) };
        let noisy = step.uniform::<f64>(3) < 0.5;
        let shift = (step.below(4, bayer::SIDE), step.below(5, bayer::SIDE));
        keep_highest(request, kept(budget, request), |at| {
            let index = at.pixel as u64;
            let threshold =
                if noisy { noise.uniform::<f64>(index) } else { bayer::threshold(at.row, at.column, shift) };
            let preference = if gamma == 0.0 { 0.0 } else { gamma * (request.energy[at.pixel].to_f64() + 0.02).ln() };
            preference - (threshold + 1e-6 * ties.uniform::<f64>(index)).ln()
        })
    }
}
