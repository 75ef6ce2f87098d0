//! Affine color corrections of photos.

use crate::gradients::adam;
use weaver_geometry::glam::{DMat3, DVec3};

/// An affine map of colors: `rgb' = A rgb + b`, `[3, 4]` row by row, with Adam's moments.
///
/// It stands for the camera's processing of one photo (exposure, white balance); the scene keeps the colors of the
/// average photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// `[A | b]`, row by row.
    pub matrix: [f32; 12],
    pub(crate) first: [f32; 12],
    pub(crate) second: [f32; 12],
    pub(crate) steps: u64,
}

/// Numbers of a map.
pub(crate) const NUMBERS: usize = 12;
const IDENTITY: [f32; NUMBERS] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
/// Weight of the squared distance to the identity, which keeps the scene's colors from drifting.
const TO_IDENTITY: f32 = 1e-2;

/// Maps of a smaller determinant are not inverted: they lose a color.
const LEAST_DETERMINANT: f64 = 1e-3;

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

    /// The map that some maps have in common: their mean; and its inverse. `None` if it has none that can be trusted.
    pub(crate) fn common(exposures: &[Self]) -> Option<(Self, Self)> {
        let over = 1.0 / exposures.len() as f32;
        let mean = Self::mean(exposures.iter().map(|exposure| (over, exposure)));
        let column = |i: usize| DVec3::new(mean.matrix[i].into(), mean.matrix[4 + i].into(), mean.matrix[8 + i].into());
        let linear = DMat3::from_cols(column(0), column(1), column(2));
        if linear.determinant().abs() < LEAST_DETERMINANT {
            return None;
        }
        let inverse = linear.inverse();
        let offset = -(inverse * column(3));
        let at = |i: usize| if i % 4 == 3 { offset[i / 4] } else { inverse.col(i % 4)[i / 4] };
        Some((mean, Self::of(std::array::from_fn(|i| at(i) as f32))))
    }

    /// Makes this the map that applies another one first.
    pub(crate) fn follow(&mut self, first: &Self) {
        let own = self.matrix;
        self.matrix = std::array::from_fn(|i| {
            let row = &own[i / 4 * 4..][..4];
            let sum: f32 = (0..3).map(|k| row[k] * first.matrix[4 * k + i % 4]).sum();
            if i % 4 == 3 { sum + row[3] } else { sum }
        });
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

    /// Takes the gradient with respect to the corrected image back to the image, and returns that with respect to the
    /// correction.
    pub(crate) fn pull_back(&self, image: &[f32], gradient: &mut [f32]) -> [f32; NUMBERS] {
        let mut sums = [0.0_f64; NUMBERS];
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
        std::array::from_fn(|i| sums[i] as f32 + toward(i))
    }

    /// One step of the correction down a gradient; `rates` are for the gains and for the rest.
    pub(crate) fn descend(&mut self, gradient: &[f32; NUMBERS], rates: [f32; 2]) {
        self.steps += 1;
        let (steps, Self { matrix, first, second, .. }) = (self.steps, self);
        for i in 0..NUMBERS {
            let adam = adam(rates[usize::from(IDENTITY[i] == 0.0)]);
            adam.step(steps, &mut matrix[i..=i], &gradient[i..=i], &mut first[i..=i], &mut second[i..=i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::population::Population;
    use weaver_geometry::sh::DC;
    use weaver_scene::Gaussians;

    const MAPS: [[f32; 12]; 3] = [
        [1.2, 0.1, 0.0, 0.05, -0.1, 0.9, 0.0, 0.0, 0.2, 0.0, 1.1, -0.1],
        [0.8, 0.0, 0.1, 0.0, 0.0, 0.7, 0.1, 0.1, 0.0, 0.1, 0.9, 0.0],
        [1.0, -0.1, 0.0, 0.02, 0.0, 1.3, 0.0, 0.0, 0.0, 0.0, 1.2, 0.2],
    ];

    fn apply(map: &[f32; 12], color: [f32; 3]) -> [f32; 3] {
        let mut mapped = [0.0; 3];
        Exposure::of(*map).apply(&color, &mut mapped);
        mapped
    }

    /// Scene and maps change, and the images that photos are compared with do not.
    #[test]
    fn what_maps_have_in_common_moves_to_the_colors() {
        let mut maps = MAPS.map(Exposure::of);
        let (mean, inverse) = Exposure::common(&maps).unwrap();
        let sh: Vec<f32> = (0..12).map(|i| 0.3 * (i as f32 * 1.7).sin()).collect();
        let gaussians = Gaussians {
            means: vec![[0.0; 3]],
            log_scales: vec![[0.0; 3]],
            quats: vec![[1.0, 0.0, 0.0, 0.0]],
            opacity_logits: vec![0.0],
            sh,
            degree: 1,
        };
        let mut population = Population::new(&gaussians);
        population.raise_degree(1);
        population.sh.values.copy_from_slice(&gaussians.sh);
        // A direction in which the other coefficients count, too.
        let color = |population: &Population| -> [f32; 3] {
            let weights = [DC as f32, 0.3, -0.2, 0.4];
            std::array::from_fn(|c| 0.5 + (0..4).map(|k| weights[k] * population.sh.values[3 * k + c]).sum::<f32>())
        };
        let before = color(&population);
        maps.iter_mut().for_each(|map| map.follow(&inverse));
        population.map_colors(&mean.matrix);
        for (map, old) in maps.iter().zip(&MAPS) {
            let (now, then) = (apply(&map.matrix, color(&population)), apply(old, before));
            assert!(now.iter().zip(then).all(|(a, b)| (a - b).abs() < 1e-5), "{now:?}, before {then:?}");
        }
        let (mean, _) = Exposure::common(&maps).unwrap();
        assert!(mean.matrix.iter().zip(IDENTITY).all(|(a, b)| (a - b).abs() < 1e-5), "{mean:?}");
    }

    #[test]
    fn maps_that_lose_a_color_have_nothing_in_common() {
        let gray = [0.3, 0.6, 0.1, 0.0].repeat(3);
        assert!(Exposure::common(&[Exposure::of(gray.try_into().unwrap())]).is_none());
    }
}
