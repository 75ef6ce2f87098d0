//! Relocation, growth and noise of 3DGS-MCMC.

use super::{Density, Moment, Regularizer, Strategy};
use crate::population::Population;
use weaver_kernels::parallel;
use weaver_scene::forms;
use weaver_splat::GaussianStatistics;

/// Dead Gaussians move onto live ones, drawn by opacity; the number grows to the budget in the same way; noise moves
/// means of transparent Gaussians, and small weights pull opacities and scales down.
///
/// Source: Kheradmand et al., 3D Gaussian Splatting as Markov Chain Monte Carlo, 2024, equations 8 to 10.
#[derive(Clone, Debug)]
pub struct Mcmc {
    settings: Density,
}

/// The largest number of copies that equation 9 is evaluated for.
const MOST_COPIES: usize = 51;
/// Steepness and middle of the gate that keeps opaque Gaussians from being moved by noise.
const GATE: (f32, f32) = (100.0, 0.005);
/// Gaussians of a task.
const GRAIN: usize = 1 << 10;

impl Mcmc {
    /// The strategy with these settings.
    pub fn new(settings: Density) -> Self {
        Self { settings }
    }

    /// Draws `count` Gaussians of `live` with probabilities proportional to their opacities, and returns how often each
    /// of all was drawn, and the draws.
    fn draw(&self, moment: &Moment, population: &Population, live: &[bool], count: usize, first: u64) -> Vec<usize> {
        let mut sum = 0.0;
        let cumulative: Vec<f64> = (0..population.len())
            .map(|n| {
                sum += if live[n] { f64::from(population.opacity(n)) } else { 0.0 };
                sum
            })
            .collect();
        let draw = |i| {
            let at = moment.stream.uniform::<f64>(first + i as u64) * sum;
            cumulative.partition_point(|c| *c <= at).min(cumulative.len() - 1)
        };
        (0..count).map(draw).collect()
    }

    /// Puts copies of drawn Gaussians at `places` (indices of dead ones, or new rows).
    fn place(&self, population: &mut Population, drawn: &[usize], dead: &[usize]) {
        let mut copies = vec![0usize; population.len()];
        drawn.iter().for_each(|n| copies[*n] += 1);
        for (n, copies) in copies.into_iter().enumerate().filter(|(_, copies)| *copies > 0) {
            let (opacity, factor) = relocated(population.opacity(n), copies + 1);
            population.set_opacity(n, opacity.clamp(self.settings.least_opacity, 1.0 - 1e-5));
            population.log_scales.row_mut(n).iter_mut().for_each(|s| *s += factor.ln());
            population.forget(n);
        }
        for (i, n) in drawn.iter().enumerate() {
            match dead.get(i) {
                Some(place) => population.overwrite(*place, *n),
                None => _ = population.duplicate(*n),
            }
        }
    }
}

/// The opacity of each of `copies` Gaussians that stand where one of opacity `o` stood, `1 - (1 - o)^(1 / n)`, and the
/// factor of their scales (equation 9).
pub fn relocated(opacity: f32, copies: usize) -> (f32, f32) {
    let n = copies.clamp(1, MOST_COPIES);
    let o = f64::from(opacity).min(1.0 - 1e-7);
    let new = 1.0 - (1.0 - o).powf(1.0 / n as f64);
    let mut sum = 0.0;
    for i in 1..=n {
        let mut binomial = 1.0;
        for k in 0..i {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            sum += binomial * sign / ((k + 1) as f64).sqrt() * new.powi(k as i32 + 1);
            binomial *= (i - 1 - k) as f64 / (k + 1) as f64;
        }
    }
    (new as f32, (o / sum) as f32)
}

impl Strategy for Mcmc {
    fn regularizer(&self, moment: &Moment, gaussians: usize) -> Regularizer {
        self.settings.regularizer(moment, gaussians)
    }

    fn wants_statistics(&self, _: &Moment) -> bool {
        false
    }

    fn adapt(&mut self, moment: &Moment, population: &mut Population, _: &[GaussianStatistics<f32>]) -> bool {
        let round = self.settings.due(moment);
        if round {
            let live: Vec<bool> =
                (0..population.len()).map(|n| population.opacity(n) > self.settings.least_opacity).collect();
            let dead: Vec<usize> = (0..population.len()).filter(|n| !live[*n]).collect();
            if live.contains(&true) {
                let drawn = self.draw(moment, population, &live, dead.len(), 0);
                self.place(population, &drawn, &dead);
                let now = population.len();
                let more =
                    ((now as f64 * (1.0 + self.settings.growth)) as usize).min(moment.budget).saturating_sub(now);
                let drawn = self.draw(moment, population, &vec![true; now], more, 1 << 32);
                self.place(population, &drawn, &[]);
            }
        }
        self.jitter(moment, population);
        round
    }
}

impl Mcmc {
    /// mean += covariance * normal * gate(opacity) * noise * rate.
    fn jitter(&self, moment: &Moment, population: &mut Population) {
        let amount = self.settings.noise as f32 * moment.mean_rate / (moment.extent * moment.extent);
        let stream = moment.stream.fork(1);
        let mut means = std::mem::take(&mut population.means.values);
        let others = &*population;
        parallel::for_chunks(&mut means, 3 * GRAIN, |chunk, means| {
            for (i, mean) in means.chunks_exact_mut(3).enumerate() {
                let n = chunk * GRAIN + i;
                let gate = forms::opacity(-GATE.0 * (others.opacity(n) - GATE.1));
                if gate < 1e-6 {
                    continue;
                }
                let axes = others.axes(n);
                let scales = others.log_scales.row(n);
                let normal: [f32; 3] = std::array::from_fn(|k| stream.normal(3 * n as u64 + k as u64));
                for (axis, scale) in axes.iter().zip(scales) {
                    let along: f32 = axis.iter().zip(normal).map(|(a, b)| a * b).sum();
                    let shift = along * (2.0 * scale).exp() * gate * amount;
                    mean.iter_mut().zip(axis).for_each(|(m, a)| *m += shift * a);
                }
            }
        });
        population.means.values = means;
    }
}
