//! Learning rates.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Learning rates of Adam in a run of 6000 steps (3DGS's, doubled).
///
/// Gaussians have to come as far in a short run as in a long one: all rates except color corrections' are multiplied by
/// (6000 / steps)^power, at most by 2.5. A longer run has the rates of 6000 steps: with lower ones it stays in the
/// first optimum that it meets, and is overfitted there.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Rates {
    /// Rate of the means at the beginning, over the scene's size.
    pub means: f64,
    /// Factor on the rate of the means at the end; in between its logarithm is linear.
    pub means_end: f64,
    /// Rate of the logarithms of the scales.
    pub scales: f64,
    /// Rate of the quaternions.
    pub quats: f64,
    /// Rate of the opacity logits.
    pub opacities: f64,
    /// Rate of the harmonics of degree 0.
    pub sh: f64,
    /// Rate of the harmonics of higher degrees, over the rate of degree 0.
    pub sh_rest: f64,
    /// Rate of the gains of photos, where their colors are corrected.
    pub exposure: f64,
    /// Rate of the rest of a correction, mixing of channels and an offset; at 0 gains alone are corrected.
    #[serde(default = "exposure_rest")]
    pub exposure_rest: f64,
    /// Dependence of the rates of shorter runs on their length; 0 for the same rates in all.
    pub power: f64,
    /// Factor on the rates of shapes, opacities and colors at the end; over the last fifth of the run their logarithm
    /// is linear.
    #[serde(default = "constant")]
    pub end: f64,
    /// Weight of the last gradient beside Adam's running mean of the gradients, 0 to 1 (quasi-hyperbolic momentum, Ma
    /// and Yarats, 2019): steps are `rate (m / sqrt(v) + last g / sqrt(v))`, the latter quotient at most 1.5. It pays
    /// in short runs on few photos; in long ones on many it costs.
    #[serde(default)]
    pub last: f64,
}

/// Value in settings that are older than the key.
fn constant() -> f64 {
    1.0
}

/// Value in settings that are older than the key.
fn exposure_rest() -> f64 {
    2e-3
}

impl Default for Rates {
    fn default() -> Self {
        Self {
            means: 3.2e-4,
            means_end: 0.01,
            scales: 1e-2,
            quats: 2e-3,
            opacities: 0.05,
            sh: 5e-3,
            sh_rest: 1.0 / 20.0,
            exposure: 2e-3,
            exposure_rest: exposure_rest(),
            power: 0.5,
            end: 0.1,
            last: 0.0,
        }
    }
}

/// The run that rates are meant for, and their largest factor in shorter ones: the factor at 1000 steps, the shortest
/// measured run.
const STEPS: f64 = 6000.0;
const FASTEST: f64 = 2.5;
/// Longest side of the photos that rates of means were chosen by, pixels.
const RATED: usize = 384;
/// Photos up to which the usual rate of opacities pays, and the least part of it that more photos have.
const AGREEING: f64 = 30.0;
const LEAST_PART: f64 = 0.2;
/// Part of the run from which on rates fall.
const ENDING: f64 = 0.8;

impl Rates {
    /// The rates in a run of so many steps.
    pub(crate) fn in_run_of(&self, steps: usize) -> Self {
        let factor = (STEPS / steps.max(1) as f64).max(1.0).powf(self.power).min(FASTEST);
        Self {
            means: self.means * factor,
            scales: self.scales * factor,
            quats: self.quats * factor,
            opacities: self.opacities * factor,
            sh: self.sh * factor,
            ..self.clone()
        }
    }

    /// Rate of the [means](Self::means) that pays for photos of this longest side, pixels, where Gaussians begin on
    /// surfaces: these are near their places, and are moved by pixels and not by parts of the scene. Up to 384 pixels
    /// it is the usual one.
    ///
    /// ```
    /// use weaver_fit::Rates;
    /// let usual = Rates::default().means;
    /// assert_eq!([200, 384, 1536].map(Rates::means_on_surfaces), [usual, usual, usual / 4.0]);
    /// ```
    pub fn means_on_surfaces(long_side: usize) -> f64 {
        Self::default().means * RATED as f64 / long_side.max(RATED) as f64
    }

    /// Rate of the [opacities](Self::opacities) that pays for so many photos: the usual one up to 30, then
    /// `(30 / photos)^2` of it, a fifth at least.
    ///
    /// Many photos contradict each other, by visitors, by light, by what shines. Each step then makes what it sees more
    /// transparent or more opaque by one photo alone, and at the usual rate a scene becomes fog.
    ///
    /// ```
    /// use weaver_fit::Rates;
    /// let usual = Rates::default().opacities;
    /// assert_eq!([12, 30, 60, 300].map(Rates::opacities_for), [usual, usual, 0.25 * usual, 0.2 * usual]);
    /// ```
    pub fn opacities_for(photos: usize) -> f64 {
        let part = (AGREEING / photos.max(1) as f64).powi(2);
        Self::default().opacities * part.clamp(LEAST_PART, 1.0)
    }

    /// The rates at a part of the run.
    pub(crate) fn at(&self, fraction: f64) -> Self {
        let factor = self.end.powf(((fraction - ENDING) / (1.0 - ENDING)).max(0.0));
        Self {
            scales: self.scales * factor,
            quats: self.quats * factor,
            opacities: self.opacities * factor,
            sh: self.sh * factor,
            ..self.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Promise (kept): rates of a fit fall over its last fifth; the last gradient counts with its weight beside
    /// Adam's mean, bounded.
    #[test]
    fn rates_fall_at_the_end() {
        let rates = Rates { end: 0.1, ..Rates::default() };
        for (fraction, factor) in [(0.0, 1.0), (0.8, 1.0), (0.9, 0.1_f64.sqrt()), (1.0, 0.1)] {
            let now = rates.at(fraction);
            for (now, before) in [(now.scales, rates.scales), (now.opacities, rates.opacities), (now.sh, rates.sh)] {
                assert!((now / before - factor).abs() < 1e-9, "{fraction}: {now}");
            }
            assert_eq!(now.means, rates.means);
        }
        assert_eq!(Rates { end: 1.0, ..rates.clone() }.at(1.0).sh, rates.sh);
    }

    /// Short runs go in longer steps and long ones in the same.
    #[test]
    fn short_runs_go_in_longer_steps() {
        let rates = Rates::default();
        let means = |steps| rates.in_run_of(steps).means / rates.means;
        assert!((means(1500) - 2.0).abs() < 1e-12);
        assert_eq!([100, 6000, 60_000].map(means), [FASTEST, 1.0, 1.0]);
        let constant = Rates { power: 0.0, ..rates.clone() };
        assert_eq!(constant.in_run_of(1500), constant);
        assert_eq!(rates.in_run_of(1500).exposure, rates.exposure);
    }
}
