//! Gaussians in the form in which they are predicted and drawn.

use crate::forms::opacity;
use crate::{Color, GaussianSlices, Gaussians};
use weaver_geometry::{glam::DVec3, sh};

/// Gaussians in activated form: standard deviations instead of their logarithms, opacities instead of logits. `N` is
/// the number of Gaussians.
///
/// Networks predict this form and rasterizers draw it. Files hold the stored form, [`Gaussians`]. Conversion to it and
/// back rounds, so predictions are drawn without that detour.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ActivatedGaussians {
    /// Centers in world units, `[N, 3]`.
    pub means: Vec<f32>,
    /// Standard deviations along the Gaussian's axes in world units, `[N, 3]`.
    pub scales: Vec<f32>,
    /// Rotations from the Gaussian's axes to the world's, quaternions wxyz, `[N, 4]`.
    pub quats: Vec<f32>,
    /// Opacities in `[0, 1]`, `[N]`.
    pub opacities: Vec<f32>,
    /// Spherical-harmonics coefficients, `[N, K, 3]` with `K = (degree + 1)^2`.
    pub sh: Vec<f32>,
    /// Degree of the spherical harmonics, 0 to 4.
    pub degree: usize,
}

impl ActivatedGaussians {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.opacities.len()
    }

    /// True if there are no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.opacities.is_empty()
    }

    /// The color of each Gaussian as it is seen from a place, `[N, 3]`: `max(0, 1/2 + Σ h Y)`, sRGB.
    ///
    /// ```
    /// use weaver_geometry::glam::DVec3;
    /// use weaver_scene::{ActivatedGaussians, forms::harmonic};
    /// let gaussians = ActivatedGaussians { means: vec![0.0, 0.0, 2.0], sh: [0.2, 0.4, 0.6].map(harmonic).to_vec(), ..Default::default() };
    /// let [r, g, b] = gaussians.colors_from(DVec3::ZERO)[0];
    /// assert!((r - 0.2).abs() < 1e-6 && (g - 0.4).abs() < 1e-6 && (b - 0.6).abs() < 1e-6);
    /// ```
    pub fn colors_from(&self, eye: DVec3) -> Vec<[f64; 3]> {
        let rows = self.means.chunks_exact(3).zip(self.sh.chunks_exact(3 * sh::coefficients(self.degree)));
        let of = |(mean, row): (&[f32], &[f32])| {
            let [x, y, z] = [0, 1, 2].map(|axis| f64::from(mean[axis]) - eye[axis]);
            let length = (x * x + y * y + z * z).sqrt().max(f64::MIN_POSITIVE);
            let basis = sh::basis(self.degree, [x / length, y / length, z / length], |c| c);
            [0, 1, 2].map(|channel| {
                let sum: f64 = row.iter().skip(channel).step_by(3).zip(basis).map(|(h, b)| f64::from(*h) * b).sum();
                (0.5 + sum).max(0.0)
            })
        };
        rows.map(of).collect()
    }

    /// The Gaussians in the form that a rasterizer takes, without features.
    pub fn as_slices(&self) -> GaussianSlices<'_, f32> {
        GaussianSlices {
            means: &self.means,
            quats: &self.quats,
            scales: &self.scales,
            opacities: &self.opacities,
            color: Color::Sh { coefficients: &self.sh, degree: self.degree },
            features: None,
            groups: None,
        }
    }

    /// Converts to the stored form: `log_scale = ln(scale)`, `logit = ln(opacity / (1 - opacity))`.
    ///
    /// Scales below 1e-12 become 1e-12, opacities are clamped to `[1e-6, 1 - 1e-6]`, so that every number is finite.
    pub fn to_stored(&self) -> Gaussians {
        let scales: Vec<f32> = self.scales.iter().map(|s| s.max(1e-12).ln()).collect();
        let logit = |p: &f32| {
            let p = f64::from(*p).clamp(1e-6, 1.0 - 1e-6);
            (p / (1.0 - p)).ln() as f32
        };
        Gaussians {
            means: self.means.as_chunks().0.to_vec(),
            log_scales: scales.as_chunks().0.to_vec(),
            quats: self.quats.as_chunks().0.to_vec(),
            opacity_logits: self.opacities.iter().map(logit).collect(),
            sh: self.sh.clone(),
            degree: self.degree,
        }
    }
}

impl Gaussians {
    /// Converts to the activated form: `scale = exp(log_scale)`, `opacity = 1 / (1 + exp(-logit))`; everything else is
    /// copied.
    pub fn to_activated(&self) -> ActivatedGaussians {
        ActivatedGaussians {
            means: self.means.as_flattened().to_vec(),
            scales: self.log_scales.as_flattened().iter().map(|s| s.exp()).collect(),
            quats: self.quats.as_flattened().to_vec(),
            opacities: self.opacity_logits.iter().map(|logit| opacity(*logit)).collect(),
            sh: self.sh.clone(),
            degree: self.degree,
        }
    }
}
