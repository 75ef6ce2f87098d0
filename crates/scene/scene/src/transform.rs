//! Gaussians carried into another world.

use crate::Gaussians;
use weaver_geometry::glam::{DQuat, DVec3};
use weaver_geometry::{Similarity, sh};

impl Gaussians {
    /// The Gaussians as they are in the world that a similarity transform leads to: drawn from a camera that is carried
    /// over too ([`Similarity::apply_to_pose`]), they give the same picture.
    ///
    /// Means are mapped, scales multiplied, rotations composed, and harmonics rotated.
    pub fn transformed(&self, to: &Similarity) -> Self {
        let turn = DQuat::from_mat3(&to.rotation);
        let log_scale = to.scale.ln() as f32;
        let mean = |m: &[f32; 3]| to.apply(DVec3::from(m.map(f64::from))).as_vec3().to_array();
        let quat = |q: &[f32; 4]| {
            let [w, x, y, z] = q.map(f64::from);
            let q = turn * DQuat::from_xyzw(x, y, z, w);
            [q.w as f32, q.x as f32, q.y as f32, q.z as f32]
        };
        Self {
            means: self.means.iter().map(mean).collect(),
            log_scales: self.log_scales.iter().map(|s| s.map(|s| s + log_scale)).collect(),
            quats: self.quats.iter().map(quat).collect(),
            opacity_logits: self.opacity_logits.clone(),
            sh: self.rotated_harmonics(to),
            degree: self.degree,
        }
    }

    fn rotated_harmonics(&self, to: &Similarity) -> Vec<f32> {
        let bands = sh::rotation(self.degree, &to.rotation);
        let mut rotated = self.sh.clone();
        let width = 3 * self.coefficients();
        for (to, from) in rotated.chunks_exact_mut(width).zip(self.sh.chunks_exact(width)) {
            for (matrix, l) in bands.iter().zip(1..) {
                let (first, n) = (sh::coefficients(l - 1), 2 * l + 1);
                for (i, row) in matrix.chunks_exact(n).enumerate() {
                    for c in 0..3 {
                        let coefficient = |j: usize| f64::from(from[3 * (first + j) + c]);
                        let sum: f64 = row.iter().enumerate().map(|(j, m)| m * coefficient(j)).sum();
                        to[3 * (first + i) + c] = sum as f32;
                    }
                }
            }
        }
        rotated
    }
}
