//! Gaussians in the form that files store.

use weaver_geometry::sh;

/// Gaussians in stored form: logarithms of scales, logits of opacities. `N` is the number of Gaussians.
///
/// The fields follow a 3DGS PLY file. The type does not enforce that their lengths agree; see
/// [`Gaussians::lengths_agree`].
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Gaussians {
    /// Centers in world units, `[N, 3]`.
    pub means: Vec<[f32; 3]>,
    /// Natural logarithms of the standard deviations along the Gaussian's axes in world units, `[N, 3]`.
    pub log_scales: Vec<[f32; 3]>,
    /// Rotations from the Gaussian's axes to the world's, quaternions wxyz, not necessarily of unit length, `[N, 4]`.
    pub quats: Vec<[f32; 4]>,
    /// Opacities before the sigmoid, `[N]`; infinite for opacities of 0 and 1.
    pub opacity_logits: Vec<f32>,
    /// Spherical-harmonics coefficients, `[N, K, 3]` with `K = (degree + 1)^2`.
    pub sh: Vec<f32>,
    /// Degree of the spherical harmonics, 0 to 4.
    pub degree: usize,
}

impl Gaussians {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// True if there are no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// Spherical-harmonics coefficients per color channel, `K = (degree + 1)^2`.
    pub fn coefficients(&self) -> usize {
        sh::coefficients(self.degree)
    }

    /// True if all fields describe the same number of Gaussians, and the degree is at most 4.
    pub fn lengths_agree(&self) -> bool {
        let n = self.len();
        let lengths = [self.log_scales.len(), self.quats.len(), self.opacity_logits.len(), self.sh.len()];
        self.degree <= 4 && lengths == [n, n, n, n * self.coefficients() * 3]
    }
}
