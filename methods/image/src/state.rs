//! State of a fit between two steps.

use crate::adam::Rates;
use crate::error::{ImageError, range};
use crate::gaussians::Gaussians;
use crate::picture::Picture;
use crate::settings::FitSettings;
use weaver_kernels::optim::AdamW;

/// Everything for resuming a fit after a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FitState {
    /// The Gaussians.
    pub gaussians: Gaussians<f32>,
    /// Mean gradients and mean squares of gradients; none yet for newly added Gaussians.
    pub moments: [Gaussians<f32>; 2],
    /// For each addition of Gaussians, the index of the first and the steps before: each addition has its own count of
    /// steps.
    pub additions: Vec<[u64; 2]>,
    /// Finished steps.
    pub step: u64,
    /// Gaussians of the start.
    pub first: u64,
    /// Gaussians that were reset because of a NaN or an infinity.
    pub reset: u64,
}

impl FitState {
    /// A state before the first step.
    pub(crate) fn new(gaussians: Gaussians<f32>) -> Self {
        Self { first: gaussians.len() as u64, gaussians, ..Self::default() }
    }

    /// Checks that a state can be of a fit of this picture with these settings.
    pub(crate) fn check(&self, picture: &Picture, settings: &FitSettings) -> Result<(), ImageError> {
        self.gaussians.check()?;
        let count = self.gaussians.len();
        let most = settings.gaussians.max(self.first as usize).min(picture.pixels());
        if count > most {
            return Err(range("Gaussians of a state", format!("at most {most}"), count));
        }
        if self.step > settings.steps as u64 {
            return Err(range("steps of a state", format!("at most {}", settings.steps), self.step));
        }
        let [mean, square] = [&self.moments[0], &self.moments[1]];
        let known = mean.len();
        if known > count || square.len() != known {
            let found = format!("{known} and {}", square.len());
            return Err(range("moments of a state", format!("at most {count} of both kinds"), found));
        }
        for moments in [mean, square] {
            moments.check_lengths()?;
        }
        let firsts = self.additions.iter().map(|addition| addition[0]);
        let sorted = firsts.clone().zip(firsts.skip(1)).all(|(a, b)| a < b);
        let within = self.additions.iter().all(|[first, before]| *first < known as u64 && *before <= self.step);
        let begins = self.additions.first().is_none_or(|addition| addition[0] == 0);
        if !(sorted && within && begins && self.additions.is_empty() == (known == 0)) {
            return Err(range("additions of a state", "ascending ones from 0 on", format!("{:?}", self.additions)));
        }
        Ok(())
    }

    /// Moves the Gaussians by a step of Adam along the negative `gradient` times `scale`.
    pub(crate) fn adam(&mut self, gradient: &Gaussians<f32>, rates: &Rates, scale: f32) {
        let (known, count) = (self.moments[0].len(), self.gaussians.len());
        if known < count {
            let zeros = Gaussians::zeros(count - known);
            self.moments.iter_mut().for_each(|moments| moments.extend(&zeros));
            self.additions.push([known as u64, self.step]);
        }
        let Self { gaussians, moments: [means, squares], additions, step, .. } = self;
        let ends = additions.iter().skip(1).map(|addition| addition[0] as usize).chain([count]);
        for ([first, before], end) in additions.iter().zip(ends) {
            let number = *step + 1 - before;
            let mut update = |of: fn(&mut Gaussians<f32>) -> &mut Vec<f32>, slopes: &[f32], columns: &[f32]| {
                let width = columns.len();
                let own = width * *first as usize..width * end;
                let settings =
                    AdamW { rate: 1.0, beta1: 0.9, beta2: 0.999, eps: 1e-15, weight_decay: 0.0, gradient_scale: scale };
                let (mean, square) = (&mut of(means)[own.clone()], &mut of(squares)[own.clone()]);
                let numbers = &mut of(gaussians)[own.clone()];
                settings.step_columns(number, numbers, &slopes[own], mean, square, columns);
            };
            update(|of| &mut of.centers, &gradient.centers, &rates.center);
            update(|of| &mut of.scales, &gradient.scales, &[rates.scale; 2]);
            update(|of| &mut of.angles, &gradient.angles, &[rates.angle]);
            update(|of| &mut of.colors, &gradient.colors, &[rates.color; 3]);
        }
    }

    /// Clears the moments of a Gaussian.
    pub(crate) fn forget(&mut self, i: usize) {
        for moments in &mut self.moments {
            moments.centers[2 * i..2 * i + 2].fill(0.0);
            moments.scales[2 * i..2 * i + 2].fill(0.0);
            moments.angles[i] = 0.0;
            moments.colors[3 * i..3 * i + 3].fill(0.0);
        }
    }
}
