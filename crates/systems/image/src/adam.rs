//! Adam for Gaussians, some of which were added later than others.

use crate::gaussians::Gaussians;
use weaver_kernels::optim::AdamW;

/// Rates of Adam: about how far a step moves each number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Centers, x and y, pixels.
    pub center: [f32; 2],
    /// Scales, pixels.
    pub scale: f32,
    /// Angles, radians; of the published method, their logits.
    pub angle: f32,
    /// Colors.
    pub color: f32,
}

impl Rates {
    /// The same proportions.
    pub fn times(&self, factor: f32) -> Self {
        Self {
            center: self.center.map(|rate| factor * rate),
            scale: factor * self.scale,
            angle: factor * self.angle,
            color: factor * self.color,
        }
    }
}

/// Moments of Adam. Gaussians that are added begin with none, and their own count of steps.
#[derive(Clone, Debug, Default)]
pub struct Adam {
    mean: Gaussians<f32>,
    square: Gaussians<f32>,
    steps: u64,
    /// For each addition, the first Gaussian and the steps before it.
    additions: Vec<(usize, u64)>,
}

impl Adam {
    /// Moves `gaussians` along the negative gradient, of which `scale` is a factor.
    pub fn step(&mut self, gaussians: &mut Gaussians<f32>, gradient: &Gaussians<f32>, rates: &Rates, scale: f32) {
        let known = self.mean.len();
        if known < gaussians.len() {
            let zeros = Gaussians::zeros(gaussians.len() - known);
            self.mean.extend(&zeros);
            self.square.extend(&zeros);
            self.additions.push((known, self.steps));
        }
        self.steps += 1;
        let ends = self.additions.iter().skip(1).map(|addition| addition.0).chain([gaussians.len()]);
        for ((first, before), end) in self.additions.iter().zip(ends) {
            let step = self.steps - before;
            let mut update = |of: fn(&mut Gaussians<f32>) -> &mut Vec<f32>, slopes: &[f32], columns: &[f32]| {
                let width = columns.len();
                let range = width * first..width * end;
                let settings =
                    AdamW { rate: 1.0, beta1: 0.9, beta2: 0.999, eps: 1e-15, weight_decay: 0.0, gradient_scale: scale };
                let (mean, square) = (&mut of(&mut self.mean)[range.clone()], &mut of(&mut self.square)[range.clone()]);
                let numbers = &mut of(gaussians)[range.clone()];
                settings.step_columns(step, numbers, &slopes[range], mean, square, columns);
            };
            update(|of| &mut of.centers, &gradient.centers, &rates.center);
            update(|of| &mut of.scales, &gradient.scales, &[rates.scale; 2]);
            update(|of| &mut of.angles, &gradient.angles, &[rates.angle]);
            update(|of| &mut of.colors, &gradient.colors, &[rates.color; 3]);
        }
    }

    /// Forgets the moments of a Gaussian.
    pub fn forget(&mut self, i: usize) {
        for moments in [&mut self.mean, &mut self.square] {
            moments.centers[2 * i..2 * i + 2].fill(0.0);
            moments.scales[2 * i..2 * i + 2].fill(0.0);
            moments.angles[i] = 0.0;
            moments.colors[3 * i..3 * i + 3].fill(0.0);
        }
    }
}
