//! The activated form of a population, gradients with respect to it, and the step that they lead to.

use crate::population::{Field, Population};
use crate::rates::Rates;
use weaver_geometry::sh::{MAX_DEGREE, coefficients};
use weaver_kernels::optim::AdamW;
use weaver_kernels::parallel::for_chunks;
use weaver_kernels::random::Stream;
use weaver_kernels::{Real, simd};
use weaver_scene::{Color, GaussianSlices};

/// Numbers of a task.
const GRAIN: usize = 1 << 13;

/// Gradients with respect to activated Gaussians.
#[derive(Clone, Debug, Default)]
pub struct Gradients {
    /// With respect to the means, `[N, 3]`.
    pub means: Vec<f32>,
    /// With respect to the quaternions, `[N, 4]`.
    pub quats: Vec<f32>,
    /// With respect to the standard deviations, `[N, 3]`.
    pub scales: Vec<f32>,
    /// With respect to the opacities, `[N]`.
    pub opacities: Vec<f32>,
    /// With respect to the harmonics, `[N, 3 K]`.
    pub sh: Vec<f32>,
}

/// Room for gradients, wherever it is.
#[derive(Debug)]
pub(crate) struct GradientsMut<'a> {
    pub means: &'a mut [f32],
    pub quats: &'a mut [f32],
    pub scales: &'a mut [f32],
    pub opacities: &'a mut [f32],
    pub sh: &'a mut [f32],
}

/// The numbers of a population that are not stored as they are drawn.
#[derive(Clone, Debug, Default)]
pub(crate) struct Activated {
    scales: Vec<f32>,
    opacities: Vec<f32>,
    /// Factors on the opacities while some Gaussians are dropped, and their products; empty where none are.
    factors: Vec<f32>,
    dropped: Vec<f32>,
}

impl Activated {
    /// Computes scales and opacities.
    pub fn update(&mut self, population: &Population) {
        let stored = &population.log_scales.values;
        let logits = &population.logits.values;
        self.scales.resize(stored.len(), 0.0);
        self.opacities.resize(logits.len(), 0.0);
        each(&mut self.scales, stored, Real::exp);
        each(&mut self.opacities, logits, |x| 1.0 / (1.0 + Real::exp(-x)));
        self.factors.clear();
        self.dropped.clear();
    }

    /// Drops a part of the Gaussians, drawn at random, until the next [`update`](Self::update): their opacity is 0, and
    /// the others' is larger by the inverse of the remaining part, so that pictures stay as bright in the mean.
    pub fn drop_part(&mut self, part: f64, stream: Stream) {
        let (part, kept) = (part as f32, 1.0 / (1.0 - part as f32));
        let factor = |n: usize| if stream.uniform::<f32>(n as u64) < part { 0.0 } else { kept };
        self.factors.extend((0..self.opacities.len()).map(factor));
        self.dropped.extend(self.opacities.iter().zip(&self.factors).map(|(o, k)| (o * k).min(1.0)));
    }

    /// The population as a rasterizer takes it.
    pub fn slices<'a>(&'a self, population: &'a Population) -> GaussianSlices<'a, f32> {
        GaussianSlices {
            means: &population.means.values,
            quats: &population.quats.values,
            scales: &self.scales,
            opacities: if self.dropped.is_empty() { &self.opacities } else { &self.dropped },
            color: Color::Sh { coefficients: &population.sh.values, degree: population.degree() },
            features: None,
            groups: None,
        }
    }
}

/// to = f(from), in parallel.
fn each(to: &mut [f32], from: &[f32], f: impl Fn(f32) -> f32 + Sync) {
    for_chunks(to, GRAIN, |chunk, to| {
        simd::dispatch(
            #[inline(always)]
            || to.iter_mut().zip(&from[chunk * GRAIN..]).for_each(|(to, from)| *to = f(*from)),
        );
    });
}

impl Gradients {
    /// Makes room for a population. The contents have no meaning.
    pub(crate) fn resize(&mut self, population: &Population) {
        let arrays = [&mut self.means, &mut self.scales, &mut self.quats, &mut self.opacities, &mut self.sh];
        for (array, (_, field)) in arrays.into_iter().zip(population.fields()) {
            array.resize(field.values.len(), 0.0);
        }
    }

    pub(crate) fn parts_mut(&mut self) -> GradientsMut<'_> {
        let Self { means, quats, scales, opacities, sh } = self;
        GradientsMut { means, quats, scales, opacities, sh }
    }

    /// Turns gradients with respect to scales and opacities into those with respect to their logarithms and logits.
    fn pull_back(&mut self, activated: &Activated) {
        let times = |gradients: &mut [f32], values: &[f32], slope: fn(f32) -> f32| {
            for_chunks(gradients, GRAIN, |chunk, gradients| {
                gradients.iter_mut().zip(&values[chunk * GRAIN..]).for_each(|(g, x)| *g *= slope(*x));
            });
        };
        times(&mut self.scales, &activated.scales, |s| s);
        times(&mut self.opacities, &activated.opacities, |o| o * (1.0 - o));
        let drawn = activated.factors.iter().zip(&activated.dropped);
        self.opacities.iter_mut().zip(drawn).for_each(|(g, (k, o))| *g *= if *o < 1.0 { *k } else { 0.0 });
    }

    /// One step of Adam on all parameters; `step` counts from 1, `mean_rate` is the rate of the means now.
    pub(crate) fn apply(
        &mut self,
        step: u64,
        population: &mut Population,
        activated: &Activated,
        rates: &Rates,
        mean_rate: f32,
    ) {
        self.pull_back(activated);
        let by = |rate: f64| adam(rate as f32);
        let first = rates.sh as f32;
        let rest = (rates.sh * rates.sh_rest) as f32;
        let columns: [f32; 3 * coefficients(MAX_DEGREE)] = std::array::from_fn(|i| if i < 3 { first } else { rest });
        let columns = &columns[..population.sh.width()];
        let gradients = [&self.means, &self.scales, &self.quats, &self.opacities];
        let settings = [adam(mean_rate), by(rates.scales), by(rates.quats), by(rates.opacities)];
        let [means, scales, quats, logits, sh] = population.fields_mut();
        for ((field, gradient), adam) in [means, scales, quats, logits].into_iter().zip(gradients).zip(settings) {
            adam.step(step, &mut field.values, gradient, &mut field.first, &mut field.second);
            follow_last(step, field, gradient, &[adam.rate], rates.last as f32);
        }
        adam(1.0).step_columns(step, &mut sh.values, &self.sh, &mut sh.first, &mut sh.second, columns);
        follow_last(step, sh, &self.sh, columns, rates.last as f32);
    }
}

/// Bound on the last gradient over the root of the running mean square: of a Gaussian that is new or seldom seen the
/// ratio can be ten and more, and would throw it away.
const LARGEST: f32 = 1.5;

/// Goes on from a step of Adam by the last gradient alone: `weight rate clamp(g / sqrt(v))`, each column with a rate of
/// its own.
fn follow_last(step: u64, field: &mut Field, gradient: &[f32], columns: &[f32], weight: f32) {
    if weight == 0.0 {
        return;
    }
    let AdamW { beta2, eps, .. } = adam(weight);
    let over = 1.0 / (1.0 - f64::from(beta2).powf(step as f64)) as f32;
    let second = &field.second;
    for_chunks(&mut field.values, GRAIN, |chunk, values| {
        let from = chunk * GRAIN;
        let slopes = second[from..].iter().zip(&gradient[from..]);
        let rates = columns.iter().cycle().skip(from % columns.len());
        values.iter_mut().zip(slopes).zip(rates).for_each(|((x, (v, g)), rate)| {
            *x -= weight * rate * (g / ((v * over).sqrt() + eps)).clamp(-LARGEST, LARGEST);
        });
    });
}

/// Adam as 3DGS uses it: an eps far below any gradient, so that steps do not depend on the size of gradients.
pub(crate) fn adam(rate: f32) -> AdamW<f32> {
    AdamW { rate, beta1: 0.9, beta2: 0.999, eps: 1e-15, weight_decay: 0.0, gradient_scale: 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_scene::Gaussians;

    /// The last gradient counts with its weight beside Adam's mean, in every column with its own rate; at 0
    /// steps are Adam's.
    ///
    /// Promise of `rates_fall_at_the_end`.
    #[test]
    fn the_last_gradient_counts() {
        const COUNT: usize = 5000;
        let gradient = |step: u64, i: usize| ((step as usize * 31 + i * 17) % 13) as f32 - 6.0;
        let columns = [0.5, 0.25, 0.125];
        for weight in [0.0, 0.5] {
            let mut field = Field::new(vec![1.0; 3 * COUNT], 3);
            let mut twin = vec![[1.0_f64, 0.0, 0.0]; 3 * COUNT];
            for step in 1..=5 {
                let gradients: Vec<f32> = (0..3 * COUNT).map(|i| gradient(step, i)).collect();
                let Field { values, first, second, .. } = &mut field;
                adam(1.0).step_columns(step, values, &gradients, first, second, &columns);
                follow_last(step, &mut field, &gradients, &columns, weight);
                for (i, [x, m, v]) in twin.iter_mut().enumerate() {
                    let g = f64::from(gradient(step, i));
                    (*m, *v) = (0.9 * *m + 0.1 * g, 0.999 * *v + 0.001 * g * g);
                    let mean = *m / (1.0 - 0.9_f64.powi(step as i32));
                    let root = (*v / (1.0 - 0.999_f64.powi(step as i32))).sqrt();
                    let last = (g / (root + 1e-15)).clamp(-1.5, 1.5);
                    *x -= f64::from(columns[i % 3]) * (mean / (root + 1e-15) + f64::from(weight) * last);
                }
            }
            let off =
                field.values.iter().zip(&twin).map(|(x, [twin, ..])| (f64::from(*x) - twin).abs()).fold(0.0, f64::max);
            assert!(off < 1e-4, "weight {weight}: {off}");
        }
    }

    /// As many Gaussians are dropped as said, the mean opacity stays, and gradients of logits belong to the
    /// drawn opacities.
    #[test]
    fn dropped_gaussians() {
        const COUNT: usize = 20_000;
        let gaussians = Gaussians {
            means: vec![[0.0; 3]; COUNT],
            log_scales: vec![[0.0; 3]; COUNT],
            quats: vec![[1.0, 0.0, 0.0, 0.0]; COUNT],
            opacity_logits: (0..COUNT).map(|n| -3.0 + 6.0 * n as f32 / COUNT as f32).collect(),
            sh: vec![0.0; 3 * COUNT],
            degree: 0,
        };
        let population = Population::new(&gaussians);
        let drawn = |logit: f32, factor: f32| (factor / (1.0 + (-logit).exp())).min(1.0);
        let mut activated = Activated::default();
        activated.update(&population);
        activated.drop_part(0.2, Stream::new(1, 2, "test"));
        let dropped = activated.dropped.iter().filter(|opacity| **opacity == 0.0).count();
        assert!((dropped as f64 / COUNT as f64 - 0.2).abs() < 0.01, "{dropped}");
        let mut gradients = Gradients { opacities: vec![1.0; COUNT], ..Gradients::default() };
        gradients.pull_back(&activated);
        for (n, logit) in gaussians.opacity_logits.iter().enumerate().step_by(97) {
            let factor = activated.factors[n];
            assert_eq!(activated.slices(&population).opacities[n], activated.dropped[n]);
            assert!((activated.dropped[n] - drawn(*logit, factor)).abs() < 1e-6);
            if (drawn(*logit, factor) - 1.0).abs() > 1e-3 {
                let slope = (drawn(logit + 1e-2, factor) - drawn(logit - 1e-2, factor)) / 2e-2;
                assert!((gradients.opacities[n] - slope).abs() < 1e-3, "{n}: {} {slope}", gradients.opacities[n]);
            }
        }
        // Where nothing is cut off, the rest makes up for the dropped ones.
        let clear = |of: &[f32]| of[..COUNT / 2].iter().map(|o| f64::from(*o)).sum::<f64>();
        assert!((clear(&activated.dropped) / clear(&activated.opacities) - 1.0).abs() < 0.02);
        activated.update(&population);
        assert_eq!(activated.slices(&population).opacities, &activated.opacities[..]);
    }
}
