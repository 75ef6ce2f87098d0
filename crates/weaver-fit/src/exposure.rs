//! Affine color corrections of photos.

use crate::gradients::adam;

/// An affine map of colors: `rgb' = A rgb + b`, `[3, 4]` row by row, with Adam's moments.
///
/// It stands for what a camera did to one photo (exposure, white balance); the scene keeps the colors of the average photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// `[A | b]`, row by row.
    pub matrix: [f32; 12],
    pub(crate) first: [f32; 12],
    pub(crate) second: [f32; 12],
    pub(crate) steps: u64,
}

const IDENTITY: [f32; 12] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
/// Weight of the squared distance to the identity, which keeps the scene's colors from drifting.
const TO_IDENTITY: f32 = 1e-2;

impl Default for Exposure {
    fn default() -> Self {
        Self { matrix: IDENTITY, first: [0.0; 12], second: [0.0; 12], steps: 0 }
    }
}

impl Exposure {
    /// Gains of red, green and blue.
    pub fn of_gains(gains: [f32; 3]) -> Self {
        let mut exposure = Self::default();
        gains.iter().enumerate().for_each(|(channel, gain)| exposure.matrix[5 * channel] = *gain);
        exposure
    }

    /// The map of this matrix `[A | b]`, row by row.
    pub fn of(matrix: [f32; 12]) -> Self {
        Self { matrix, ..Self::default() }
    }

    /// The mean of maps with these weights, whose sum is 1.
    pub(crate) fn mean<'e>(weighted: impl IntoIterator<Item = (f32, &'e Self)>) -> Self {
        let mut matrix = [0.0; 12];
        for (weight, exposure) in weighted {
            matrix.iter_mut().zip(&exposure.matrix).for_each(|(sum, x)| *sum += weight * x);
        }
        Self::of(matrix)
    }

    /// Corrects an image `[H, W, 3]`.
    pub fn apply(&self, image: &[f32], corrected: &mut [f32]) {
        let e = &self.matrix;
        for (from, to) in image.chunks_exact(3).zip(corrected.chunks_exact_mut(3)) {
            for (to, row) in to.iter_mut().zip(e.chunks_exact(4)) {
                *to = row[0] * from[0] + row[1] * from[1] + row[2] * from[2] + row[3];
            }
        }
    }

    /// Takes the gradient with respect to the corrected image back to the image, and one step of the correction; `rates` are those of
    /// the gains and of the rest.
    pub(crate) fn descend(&mut self, image: &[f32], gradient: &mut [f32], rates: [f32; 2]) {
        let mut sums = [0.0_f64; 12];
        let e = self.matrix;
        for (from, g) in image.chunks_exact(3).zip(gradient.chunks_exact_mut(3)) {
            for (row, g) in g.iter().enumerate() {
                (0..3).for_each(|i| sums[4 * row + i] += f64::from(g * from[i]));
                sums[4 * row + 3] += f64::from(*g);
            }
            let back = |i: usize| e[i] * g[0] + e[4 + i] * g[1] + e[8 + i] * g[2];
            let back = [back(0), back(1), back(2)];
            g.copy_from_slice(&back);
        }
        let toward = |i: usize| 2.0 * TO_IDENTITY * (e[i] - IDENTITY[i]);
        let gradient: [f32; 12] = std::array::from_fn(|i| sums[i] as f32 + toward(i));
        self.steps += 1;
        let (steps, Self { matrix, first, second, .. }) = (self.steps, self);
        for i in 0..12 {
            let adam = adam(rates[usize::from(IDENTITY[i] == 0.0)]);
            adam.step(steps, &mut matrix[i..=i], &gradient[i..=i], &mut first[i..=i], &mut second[i..=i]);
        }
    }
}
