//! Colors as coefficients of a transform in space.
//!
//! A Gaussian's harmonics, in units of its own steps, are transformed by [`Raht`] with the squares of these units as
//! weights: colors that are equal end up in one coefficient for any steps, and an error of a coefficient is one of the
//! same size in steps.

use super::head::{Head, UNIT};
use super::symbols::{Symbols, ln_opacities};
use crate::error::CodecError;
use crate::quantizer::Quantizer;
use crate::raht::Raht;
use weaver_scene::Gaussians;

/// Orthonormal mixtures of red, green and blue.
const MIXTURES: [[f32; 3]; 3] = [
    [0.577_350_26, 0.577_350_26, 0.577_350_26],
    [std::f32::consts::FRAC_1_SQRT_2, 0.0, -std::f32::consts::FRAC_1_SQRT_2],
    [0.408_248_3, -0.816_496_6, 0.408_248_3],
];

/// Largest magnitude of a coefficient's symbol.
pub(super) const LARGEST_COEFFICIENT: i32 = 1 << 23;

/// Largest magnitude of a color in steps, so that no sum of many is beyond the largest coefficient.
const LARGEST_COLOR: f64 = 1_048_576.0;

/// Symbols of Gaussians that are coded together, and the transform of their colors.
#[derive(Debug)]
pub(super) struct Block {
    pub(super) symbols: Symbols,
    pub(super) raht: Raht,
}

/// Factors of the steps of each Gaussian's colors.
pub(super) fn factors(head: &Head, symbols: &Symbols) -> Vec<f64> {
    let logs = ln_opacities(head.opacity_levels);
    let shapes = symbols.scales.iter().zip(&symbols.opacities);
    shapes.map(|(&scales, &opacity)| head.steps(scales, head.shows(scales, opacity, &logs)).factor).collect()
}

/// The transform of Gaussians at these voxels, whose steps have these factors.
pub(super) fn transform(voxels: &[u64], factors: &[f64]) -> Result<Raht, CodecError> {
    Raht::new(voxels, &factors.iter().map(|factor| 1.0 / (factor * factor)).collect::<Vec<_>>())
}

impl Block {
    /// Symbols of shapes, and the colors of Gaussians of these numbers; further harmonics are rounded with a dead zone.
    pub(super) fn new(
        head: &Head,
        mut symbols: Symbols,
        gaussians: &Gaussians,
        (numbers, dead_zone): (&[usize], f64),
    ) -> Result<Self, CodecError> {
        let factors = factors(head, &symbols);
        let raht = transform(&symbols.voxels, &factors)?;
        let coefficients = gaussians.coefficients();
        let steps = steps(head);
        let mut values = Vec::with_capacity(3 * coefficients * numbers.len());
        for (&number, factor) in numbers.iter().zip(&factors) {
            let row = gaussians.sh[3 * coefficients * number..][..3 * coefficients].chunks_exact(3);
            for (k, rgb) in row.enumerate() {
                let most = LARGEST_COLOR * steps[k.min(1)];
                values.extend(MIXTURES.map(|mixture| {
                    let mixed: f64 = mixture.iter().zip(rgb).map(|(m, x)| f64::from(*m) * f64::from(*x)).sum();
                    (mixed / factor).clamp(-most, most) as f32
                }));
            }
        }
        raht.forward(&mut values, 3 * coefficients);
        let largest = LARGEST_COEFFICIENT;
        for row in values.chunks_exact(3 * coefficients) {
            let symbol = |k: usize| {
                let quantizer = Quantizer { step: steps[k.min(1)], dead_zone: if k > 0 { dead_zone } else { 0.0 } };
                [0, 1, 2].map(|m| quantizer.symbol(f64::from(row[3 * k + m])).clamp(-largest, largest))
            };
            symbols.colors.push(symbol(0));
            symbols.harmonics.extend((1..coefficients).map(symbol));
        }
        Ok(Self { symbols, raht })
    }

    /// The harmonics of the Gaussians, `[N, K, 3]`.
    pub(super) fn restore_colors(&self, head: &Head, sh: &mut [f32]) {
        let count = self.symbols.voxels.len();
        let width = sh.len() / count.max(1);
        let rest = width / 3 - 1;
        let [dc, further] = steps(head).map(|step| step as f32);
        for (i, row) in sh.chunks_exact_mut(width).enumerate() {
            let symbols = std::iter::once((&self.symbols.colors[i], dc));
            let symbols =
                symbols.chain(self.symbols.harmonics[rest * i..][..rest].iter().map(|three| (three, further)));
            for (to, (three, step)) in row.chunks_exact_mut(3).zip(symbols) {
                (0..3).for_each(|m| to[m] = three[m] as f32 * step);
            }
        }
        self.raht.inverse(sh, width);
        for (row, factor) in sh.chunks_exact_mut(width).zip(factors(head, &self.symbols)) {
            let factor = factor as f32;
            for mixed in row.chunks_exact_mut(3) {
                let [a, b, c] = [0, 1, 2].map(|m| mixed[m] * factor);
                let color =
                    |channel: usize| MIXTURES[0][channel] * a + MIXTURES[1][channel] * b + MIXTURES[2][channel] * c;
                mixed.copy_from_slice(&[color(0), color(1), color(2)]);
            }
        }
    }
}

/// Steps of degree 0, and of further harmonics, before their factors.
fn steps(head: &Head) -> [f64; 2] {
    [head.dc_step, head.sh_step].map(|parts| f64::from(parts) / UNIT)
}
