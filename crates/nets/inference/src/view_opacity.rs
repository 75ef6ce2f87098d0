//! Opacities that depend on where Gaussians are seen from.

mod rasterizer;

pub use rasterizer::ViewOpacityRasterizer;

use crate::Error;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, sh};
use weaver_io::safetensors::Planned;
use weaver_kernels::Real;
use weaver_scene::ActivatedGaussians;

/// Degree of the harmonics.
const DEGREE: usize = 2;
/// Their number.
const HARMONICS: usize = sh::coefficients(DEGREE);

/// Opacities of N Gaussians, whose logit in direction d is sum_k Y_k(d) a_k with the nine harmonics up to degree 2.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewOpacity {
    /// Coefficients a `[N, 9]`.
    pub harmonics: Vec<f32>,
}

impl ViewOpacity {
    /// Opacities `[N]` of Gaussians at `means` `[N, 3]`, seen from `center`.
    pub fn seen_from<T: Real>(&self, means: &[T], center: DVec3) -> Vec<T> {
        self.logits(means, center).map(|logit| T::from_f64(sigmoid(logit))).collect()
    }

    /// Opacities `[N]` of the mean logit over cameras, for files that hold only one.
    pub fn over(&self, means: &[f32], cameras: &[Camera]) -> Vec<f32> {
        let mut sums = vec![0.0; means.len() / 3];
        for camera in cameras {
            sums.iter_mut().zip(self.logits(means, camera.pose.center())).for_each(|(sum, logit)| *sum += logit);
        }
        sums.into_iter().map(|sum| sigmoid(sum / cameras.len().max(1) as f64) as f32).collect()
    }

    fn logits<'a, T: Real>(&'a self, means: &'a [T], center: DVec3) -> impl Iterator<Item = f64> + use<'a, T> {
        gaussians(means, &self.harmonics).map(move |(mean, numbers)| {
            let basis = sh::basis(DEGREE, direction(mean, center).0.to_array(), |x| x);
            basis.iter().zip(numbers).map(|(y, a)| y * f64::from(*a)).sum()
        })
    }

    /// The Gaussians with the opacities that a camera sees.
    pub(crate) fn of<'a>(
        opacity: Option<&Self>,
        gaussians: &'a ActivatedGaussians,
        camera: &Camera,
    ) -> Cow<'a, ActivatedGaussians> {
        let Some(opacity) = opacity else { return Cow::Borrowed(gaussians) };
        let opacities = opacity.seen_from(&gaussians.means, camera.pose.center());
        Cow::Owned(ActivatedGaussians { opacities, ..gaussians.clone() })
    }

    /// Writes Gaussians with all data of their opacities, as tensors `means`, `scales`, `quats`, `opacity_harmonics`,
    /// `sh`.
    pub(crate) fn write(&self, gaussians: &ActivatedGaussians, path: &Path) -> Result<(), Error> {
        let ActivatedGaussians { means, scales, quats, sh, degree, .. } = gaussians;
        let n = gaussians.len();
        let tensors: [(&str, &[f32], &[usize]); 5] = [
            ("means", means, &[n, 3]),
            ("scales", scales, &[n, 3]),
            ("quats", quats, &[n, 4]),
            ("opacity_harmonics", &self.harmonics, &[n, HARMONICS]),
            ("sh", sh, &[n, sh::coefficients(*degree), 3]),
        ];
        let planned = tensors.map(|(name, _, shape)| Planned {
            name: name.into(),
            dtype: "F32",
            width: 4,
            shape: shape.to_vec(),
        });
        weaver_io::safetensors::write_weights(path, &BTreeMap::new(), &planned, |tensor, to| {
            let numbers = tensors.iter().filter(|(name, ..)| *name == tensor.name).flat_map(|(_, numbers, _)| *numbers);
            numbers.into_iter().try_for_each(|x| to.write_all(&x.to_le_bytes()))
        })?;
        Ok(())
    }
}

/// The mean and the coefficients of each.
fn gaussians<'a, T>(means: &'a [T], harmonics: &'a [f32]) -> impl Iterator<Item = (&'a [T; 3], &'a [f32; HARMONICS])> {
    means.as_chunks::<3>().0.iter().zip(harmonics.as_chunks::<HARMONICS>().0)
}

/// The unit direction from a center to a mean, and how far that is; z where they are one.
fn direction<T: Real>(mean: &[T; 3], center: DVec3) -> (DVec3, f64) {
    let way = DVec3::from(mean.map(T::to_f64)) - center;
    (way.normalize_or(DVec3::Z), way.length())
}

fn sigmoid(logit: f64) -> f64 {
    1.0 / (1.0 + (-logit).exp())
}
