//! How exact an adjustment is.

use super::dense::Dense;
use super::descent::{Descent, Limits};
use super::linear::BLOCK;
use super::structure::NONE;
use super::{Bundle, TWIST};
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_kernels::parallel;

/// Directions that the world can be moved in: three of its place, three of its turn, and its scale.
const GAUGE: usize = 7;
/// What a turn counts for beside the places of cameras, over their spread: it holds the world where these are on a line.
const TURN: f64 = 0.1;
/// Cameras whose deviations are found one by one; of more, as many that are evenly spaced, and the others have the mean.
const MOST: usize = 200;

/// Standard deviations of cameras and lenses.
#[derive(Clone, Debug, PartialEq)]
pub struct Covariance {
    /// Of the noise of observations, over their deviations, as residuals show it.
    pub sigma: f64,
    /// Of logarithms of the factors of focal lengths, by lens; 0 where it is not adjusted.
    pub focal: Vec<f64>,
    /// Of k1 and k2, by lens; 0 where they are not adjusted.
    pub distortion: Vec<[f64; 2]>,
    /// Of rotations, radians, by camera: the root of the sum of the variances about three axes; 0 where it is fixed.
    pub rotation: Vec<f64>,
    /// Of centers, world units, by camera: the root of the sum of three variances; 0 where it is fixed.
    pub center: Vec<f64>,
}

impl Bundle {
    /// The standard deviations of cameras and lenses where an adjustment with this `scale` ended; `None` where observations do not
    /// hold them.
    ///
    /// They are those of the inverse of the normal equations once points are eliminated, times the variance of observations
    /// that the residuals have, each weighted as the adjustment does. If no camera is fixed or expected somewhere, the place,
    /// turn and scale of the world are left open: deviations are from the best similarity to the right centers.
    ///
    /// Sources: Triggs et al., Bundle adjustment, a modern synthesis, 1999, section 9.4, for the gauge; Huber, Robust
    /// statistics, 1981, section 7.6, for the variance.
    pub fn covariance(&self, scale: f64) -> Option<Covariance> {
        let sigma = self.noise(scale)?;
        let mut descent = Descent::new(self, scale, &Limits::USUAL);
        descent.linearize();
        descent.reduce(0.0);
        let (blocks, size) = (&descent.blocks, BLOCK * descent.reduced.rows);
        let mut dense = Dense::new(size);
        dense.load(&descent.reduced);
        let mut constraints = self.constraints(&blocks.of_camera, size);
        // As large as what it is added to, so that neither drowns in the other's rounding.
        let diagonals = (0..descent.reduced.rows).map(|row| {
            let (_, of_row) = descent.reduced.row(row);
            of_row.last().map_or(0.0, |block| (0..BLOCK).map(|k| block.0[k][k]).sum::<f64>())
        });
        let size_of = (diagonals.sum::<f64>() / size as f64).sqrt();
        constraints.iter_mut().flatten().for_each(|x| *x *= size_of);
        for row in 0..descent.reduced.rows {
            for column in (0..=row).filter(|_| !constraints.is_empty()) {
                let product = |a: usize, b: usize| {
                    constraints.iter().map(|h| h[row * BLOCK + a] * h[column * BLOCK + b]).sum::<f64>()
                };
                dense.add(row * BLOCK, column * BLOCK, product);
            }
        }
        if !dense.factor() {
            return None;
        }
        let mut held = constraints;
        held.iter_mut().for_each(|h| dense.substitute(h));
        // Of the inverse of S + H H^T, which is without a null space, less what H gave it: columns of one block.
        let variances = |block: u32| -> [[f64; BLOCK]; BLOCK] {
            let first = block as usize * BLOCK;
            std::array::from_fn(|a| {
                let mut x = vec![0.0; size];
                x[first + a] = 1.0;
                dense.substitute(&mut x);
                std::array::from_fn(|b| x[first + b] - held.iter().map(|h| h[first + a] * h[first + b]).sum::<f64>())
            })
        };
        let deviation = |variance: f64| sigma * variance.max(0.0).sqrt();
        let lens = |block: &u32| match *block {
            NONE => [0.0; 3],
            block => {
                let of = variances(block);
                [0, 1, 2].map(|k| deviation(of[k][k]))
            }
        };
        let lenses: Vec<[f64; 3]> = blocks.of_lens.iter().map(lens).collect();
        let free = |i: usize, k: usize, free: bool| if free { lenses[i][k] } else { 0.0 };
        let each = self.lenses.iter().enumerate();
        let focal = each.clone().map(|(i, lens)| free(i, 0, lens.free_focal)).collect();
        let distortion = each.map(|(i, lens)| [free(i, 1, lens.free_k1), free(i, 2, lens.free_k2)]).collect();
        let moving: Vec<usize> = (0..self.cameras.len()).filter(|i| blocks.of_camera[*i] != NONE).collect();
        let step = moving.len().div_ceil(MOST).max(1);
        let mut found: Vec<[f64; 2]> = vec![[0.0; 2]; moving.len().div_ceil(step)];
        parallel::for_chunks(&mut found, 1, |i, found| {
            let of = variances(blocks.of_camera[moving[i * step]]);
            // Centers move by the turned translation of the twist alone.
            found[0] = [3, 0].map(|first| deviation((first..first + 3).map(|k| of[k][k]).sum()));
        });
        let mean = [0, 1].map(|k| found.iter().map(|f| f[k]).sum::<f64>() / found.len().max(1) as f64);
        let (mut rotation, mut center) = (vec![0.0; self.cameras.len()], vec![0.0; self.cameras.len()]);
        for (i, camera) in moving.into_iter().enumerate() {
            let [turn, shift] = if i % step == 0 { found[i / step] } else { mean };
            (rotation[camera], center[camera]) = (turn, shift);
        }
        let all = [&rotation, &center, &focal].into_iter().flatten();
        let finite = all.copied().all(f64::is_finite);
        finite.then_some(Covariance { sigma, focal, distortion, rotation, center })
    }

    /// The standard deviation of observations over what is taken for it, so that the normal equations with the weights of the
    /// adjustment have the covariance of its estimates; `None` where nothing is left over to tell it.
    pub(crate) fn noise(&self, scale: f64) -> Option<f64> {
        let (mut squares, mut weights, mut curvatures) = (0.0, 0.0, 0.0);
        for (error, o) in self.errors().into_iter().zip(&self.observations) {
            let far = (error / (scale * o.deviation)).powi(2);
            let weight = 1.0 / (1.0 + far);
            if error.is_finite() {
                squares += (weight * error / o.deviation).powi(2) / 2.0;
                weights += weight;
                // The mean of the loss's curvatures along the residual and across.
                curvatures += 0.5 * weight * ((1.0 - far) * weight + 1.0);
            }
        }
        let cameras = self.fixed.iter().filter(|fixed| !**fixed).count();
        let points = self.agreed().into_iter().filter(|agreed| *agreed).count();
        let unknown = (TWIST * cameras + 3 * points * usize::from(!self.fixed_points)) as f64;
        let all = 2.0 * self.observations.len() as f64;
        let sigma = (squares / weights * (weights / curvatures).powi(2) * all / (all - unknown)).sqrt();
        (all > unknown && sigma.is_finite()).then_some(sigma)
    }

    /// What holds the world, as columns of a matrix H so that H^T x = 0 for steps x of cameras and lenses that do not move it: their
    /// centers as a whole, and a little their rotations. None where cameras are fixed or expected somewhere.
    fn constraints(&self, of_camera: &[u32], size: usize) -> Vec<Vec<f64>> {
        if self.fixed.contains(&true) || !self.expected.is_empty() {
            return Vec::new();
        }
        let moving: Vec<usize> = (0..self.cameras.len()).filter(|i| of_camera[*i] != NONE).collect();
        let n = moving.len().max(1) as f64;
        let center = |i: &usize| self.cameras[*i].pose.center();
        let middle = moving.iter().map(center).sum::<DVec3>() / n;
        let spread = (moving.iter().map(|i| center(i).distance_squared(middle)).sum::<f64>() / n).sqrt();
        let mut columns = vec![vec![0.0; size]; GAUGE];
        for i in &moving {
            let (from_middle, rotation) = ((center(i) - middle) / spread, self.cameras[*i].pose.rotation);
            let first = of_camera[*i] as usize * BLOCK;
            let axes = DMat3::IDENTITY;
            let mut put = |column: usize, shift: DVec3, turn: DVec3| {
                let parts = [rotation * shift, rotation * turn * (TURN * TURN * spread)];
                let to = &mut columns[column][first..][..TWIST];
                to.iter_mut().zip(parts.iter().flat_map(|p| p.to_array())).for_each(|(to, x)| *to = -x / spread);
            };
            for k in 0..3 {
                put(k, axes.col(k), DVec3::ZERO);
                put(3 + k, axes.col(k).cross(from_middle), axes.col(k));
            }
            put(6, from_middle, DVec3::ZERO);
        }
        columns
    }
}
