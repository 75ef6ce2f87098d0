//! Fewer Gaussians by merging neighbors: levels of detail.

use crate::{Gaussians, forms};
use rayon::prelude::*;
use weaver_kernels::dense::symmetric_eigen;
use weaver_kernels::nearest_neighbors::nearest_neighbors;

/// Nearest neighbors of a Gaussian that it may be merged with.
const NEIGHBORS: usize = 6;
/// The cost of merging two colors that are a whole channel apart, beside a covariance that grows e times in volume.
const COLOR: f64 = 10.0;
/// A Gaussian counts as thicker by this part of its size, the root of the trace of its covariance: one that a fit has
/// made flat may turn a little.
const THICKNESS: f64 = 0.03;
/// The largest opacity of a merged Gaussian.
const MOST_OPAQUE: f64 = 0.999;
/// Sweeps of Jacobi's rotations of a matrix of 3 x 3.
const SWEEPS: usize = 8;

/// A symmetric matrix: xx, xy, xz, yy, yz, zz.
type Symmetric = [f64; 6];

impl Gaussians {
    /// The scene with `count` Gaussians, at least one: neighbors are merged, those first whose merging changes least.
    /// More are left only where Gaussians have numbers that are not finite, which stay as they are.
    ///
    /// Two Gaussians with means m, covariances S, coefficients c and masses w, the opacity times the area from the
    /// broadest side, become one with the moments of both. With W = w_1 + w_2,
    /// ```text
    /// m = (w_1 m_1 + w_2 m_2) / W        c = (w_1 c_1 + w_2 c_2) / W
    /// S = (w_1 S_1 + w_2 S_2) / W + w_1 w_2 / W^2 (m_1 - m_2)(m_1 - m_2)^T
    /// ```
    /// and the opacity that keeps the mass W, at most 0.999. The cost of merging is an upper bound of the information
    /// that is lost, `(W ln|S| - w_1 ln|S_1| - w_2 ln|S_2|) / 2` (Runnalls, "Kullback-Leibler approach to Gaussian
    /// mixture reduction", 2007), and `10 w_1 w_2 / W |rgb_1 - rgb_2|^2` for the colors. Covariances count as
    /// thicker by 0.03 of the root of their trace.
    ///
    /// In each round a Gaussian is merged with one of its six nearest neighbors at most. The result does not depend on
    /// the number of threads.
    ///
    /// ```
    /// use weaver_scene::Gaussians;
    /// let three = Gaussians {
    ///     means: vec![[0.0; 3], [0.1, 0.0, 0.0], [9.0, 0.0, 0.0]],
    ///     log_scales: vec![[-3.0; 3]; 3],
    ///     quats: vec![[1.0, 0.0, 0.0, 0.0]; 3],
    ///     opacity_logits: vec![0.0; 3],
    ///     sh: vec![0.5; 9],
    ///     degree: 0,
    /// };
    /// let two = three.merged(2);
    /// assert_eq!(two.means, [[0.05, 0.0, 0.0], [9.0, 0.0, 0.0]]);
    /// ```
    pub fn merged(&self, count: usize) -> Self {
        let mut scene = self.clone();
        while scene.len() > count.max(1) {
            let before = scene.len();
            scene = scene.round(before - count.max(1));
            // Each Gaussian that is left stands alone, or is not finite.
            if scene.len() == before {
                break;
            }
        }
        scene
    }

    /// Merges at most `most` pairs.
    fn round(&self, most: usize) -> Self {
        let parts: Vec<Part> = (0..self.len()).into_par_iter().map(|i| Part::of(self, i)).collect();
        let partner = self.partners(&parts, most);
        let stays: Vec<usize> = (0..self.len()).filter(|&i| partner[i].is_none_or(|other| i < other)).collect();
        let mut scene = self.select(&stays);
        let k = 3 * self.coefficients();
        let merge =
            |(row, &i): (usize, &usize)| partner[i].map(|j| (row, Part::merged(&parts[i], &parts[j]).stored(), [i, j]));
        let merged: Vec<_> = stays.par_iter().enumerate().filter_map(merge).collect();
        for (row, one, [i, j]) in merged {
            (scene.means[row], scene.log_scales[row]) = (one.mean, one.log_scales);
            (scene.quats[row], scene.opacity_logits[row]) = (one.quat, one.opacity_logit);
            let share = parts[i].share(&parts[j]) as f32;
            let both = self.sh[i * k..][..k].iter().zip(&self.sh[j * k..][..k]);
            scene.sh[row * k..][..k].iter_mut().zip(both).for_each(|(to, (a, b))| *to = share * a + (1.0 - share) * b);
        }
        scene
    }

    /// The partner of each Gaussian, if any: pairs of neighbors, those first that cost least.
    fn partners(&self, parts: &[Part], most: usize) -> Vec<Option<usize>> {
        let mut neighbors = vec![0; self.len() * (1 + NEIGHBORS)];
        nearest_neighbors(self.means.as_flattened(), NEIGHBORS, &mut neighbors);
        let of = |i: usize| &neighbors[i * (1 + NEIGHBORS)..][1..=NEIGHBORS];
        let pairs = |i: usize| {
            // A pair of mutual neighbors comes once; rows of few Gaussians end with the Gaussian itself.
            let others =
                of(i).iter().map(|&j| j as usize).filter(move |&j| j != i && !(j < i && of(j).contains(&(i as u32))));
            others.map(move |j| (Part::cost(&parts[i], &parts[j]) as f32, i as u32, j as u32))
        };
        let costs = (0..self.len()).into_par_iter().flat_map_iter(pairs);
        let mut costs: Vec<(f32, u32, u32)> = costs.filter(|(cost, ..)| cost.is_finite()).collect();
        costs.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut partner = vec![None; self.len()];
        let mut left = most;
        for (_, i, j) in costs.into_iter().map(|(cost, i, j)| (cost, i as usize, j as usize)) {
            if left > 0 && partner[i].is_none() && partner[j].is_none() {
                (partner[i], partner[j]) = (Some(j), Some(i));
                left -= 1;
            }
        }
        partner
    }
}

/// The moments of a Gaussian.
#[derive(Clone, Copy, Debug)]
struct Part {
    /// Opacity times the area from the broadest side.
    mass: f64,
    mean: [f64; 3],
    covariance: Symmetric,
    color: [f64; 3],
    /// The logarithm of the determinant of the covariance, at least so thick.
    log_volume: f64,
}

/// A Gaussian as it is stored, without its harmonics.
struct Stored {
    mean: [f32; 3],
    log_scales: [f32; 3],
    quat: [f32; 4],
    opacity_logit: f32,
}

impl Part {
    fn of(gaussians: &Gaussians, i: usize) -> Self {
        let mut scales = gaussians.log_scales[i].map(|s| f64::from(s).exp());
        let covariance = covariance(gaussians.quats[i].map(f64::from), scales);
        scales.sort_by(f64::total_cmp);
        let mass = f64::from(forms::opacity(gaussians.opacity_logits[i])) * scales[1] * scales[2];
        let k = 3 * gaussians.coefficients();
        let color = std::array::from_fn(|c| f64::from(forms::color(gaussians.sh[i * k + c])));
        let mean = gaussians.means[i].map(f64::from);
        Self { mass, mean, covariance, color, log_volume: log_volume(covariance) }
    }

    /// The share of this one in both.
    fn share(&self, other: &Self) -> f64 {
        let both = self.mass + other.mass;
        // Neither is seen.
        if both > 0.0 { self.mass / both } else { 0.5 }
    }

    /// Both as one.
    fn merged(a: &Self, b: &Self) -> Self {
        let (p, q) = (a.share(b), b.share(a));
        let mix = |x: f64, y: f64| p * x + q * y;
        let d: [f64; 3] = std::array::from_fn(|i| a.mean[i] - b.mean[i]);
        let apart = [d[0] * d[0], d[0] * d[1], d[0] * d[2], d[1] * d[1], d[1] * d[2], d[2] * d[2]];
        let covariance = std::array::from_fn(|i| mix(a.covariance[i], b.covariance[i]) + p * q * apart[i]);
        Self {
            mass: a.mass + b.mass,
            mean: std::array::from_fn(|i| mix(a.mean[i], b.mean[i])),
            covariance,
            color: std::array::from_fn(|i| mix(a.color[i], b.color[i])),
            log_volume: log_volume(covariance),
        }
    }

    /// The loss of merging both.
    fn cost(a: &Self, b: &Self) -> f64 {
        let both = Self::merged(a, b);
        let lost = both.mass * both.log_volume - a.mass * a.log_volume - b.mass * b.log_volume;
        let apart: f64 = a.color.iter().zip(&b.color).map(|(x, y)| (x - y) * (x - y)).sum();
        0.5 * lost + COLOR * a.mass * b.share(a) * apart
    }

    fn stored(&self) -> Stored {
        let [xx, xy, xz, yy, yz, zz] = self.covariance;
        let (mut matrix, mut axes) = ([xx, xy, xz, xy, yy, yz, xz, yz, zz], [0.0; 9]);
        let small = 1e-14 * (xx + yy + zz);
        symmetric_eigen(&mut matrix, &mut axes, SWEEPS, |m| m[1].abs() + m[2].abs() + m[5].abs() < small);
        let least = f64::MIN_POSITIVE;
        let scales = [0, 4, 8].map(|at| matrix[at].max(least).sqrt());
        let mut sorted = scales;
        sorted.sort_by(f64::total_cmp);
        let opacity = (self.mass / (sorted[1] * sorted[2])).min(MOST_OPAQUE);
        Stored {
            mean: self.mean.map(|x| x as f32),
            log_scales: scales.map(|s| s.ln() as f32),
            quat: quaternion(axes),
            opacity_logit: forms::opacity_logit(opacity as f32),
        }
    }
}

/// `R diag(s^2) R^T` of a quaternion wxyz.
fn covariance(quat: [f64; 4], scales: [f64; 3]) -> Symmetric {
    let length = quat.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [w, x, y, z] = quat.map(|q| q / length);
    let rotation = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let at = |i: usize, j: usize| (0..3).map(|k| rotation[i][k] * rotation[j][k] * scales[k] * scales[k]).sum();
    [at(0, 0), at(0, 1), at(0, 2), at(1, 1), at(1, 2), at(2, 2)]
}

/// The logarithm of the determinant of a covariance that is at least so thick.
fn log_volume([xx, xy, xz, yy, yz, zz]: Symmetric) -> f64 {
    let thick = THICKNESS * THICKNESS * (xx + yy + zz);
    let [xx, yy, zz] = [xx + thick, yy + thick, zz + thick];
    (xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)).ln()
}

/// The quaternion wxyz of the rotation from a Gaussian's axes, the rows of `axes`, to the world's.
fn quaternion(axes: [f64; 9]) -> [f32; 4] {
    use weaver_geometry::glam::{DMat3, DQuat};
    let mut turn = DMat3::from_cols_array(&axes);
    if turn.determinant() < 0.0 {
        turn.z_axis = -turn.z_axis;
    }
    let DQuat { x, y, z, w } = DQuat::from_mat3(&turn).normalize();
    [w, x, y, z].map(|q| q as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn part(mean: [f64; 3], scales: [f64; 3], quat: [f64; 4], mass: f64, color: [f64; 3]) -> Part {
        let covariance = covariance(quat, scales);
        Part { mass, mean, covariance, color, log_volume: log_volume(covariance) }
    }

    fn any_part() -> impl Strategy<Value = Part> {
        let numbers = |low: f64, high: f64| prop::array::uniform3(low..high);
        let quat =
            prop::array::uniform4(-1.0..1.0).prop_filter("a rotation", |q: &[f64; 4]| q.iter().any(|x| x.abs() > 0.1));
        (numbers(-1.0, 1.0), numbers(0.01, 0.5), quat, 0.01..1.0, numbers(0.0, 1.0))
            .prop_map(|(mean, scales, quat, mass, color)| part(mean, scales, quat, mass, color))
    }

    /// Mass times the second moment about the origin, `w (S + m m^T)`.
    fn second(of: &Part) -> Symmetric {
        let m = of.mean;
        let outer = [m[0] * m[0], m[0] * m[1], m[0] * m[2], m[1] * m[1], m[1] * m[2], m[2] * m[2]];
        std::array::from_fn(|i| of.mass * (of.covariance[i] + outer[i]))
    }

    proptest! {
        #[test]
        fn moments_are_kept(a in any_part(), b in any_part()) {
            let both = Part::merged(&a, &b);
            prop_assert!((both.mass - a.mass - b.mass).abs() < 1e-12);
            for i in 0..3 {
                prop_assert!((both.mass * both.mean[i] - a.mass * a.mean[i] - b.mass * b.mean[i]).abs() < 1e-12);
                prop_assert!((both.mass * both.color[i] - a.mass * a.color[i] - b.mass * b.color[i]).abs() < 1e-12);
            }
            for ((x, y), z) in second(&both).into_iter().zip(second(&a)).zip(second(&b)) {
                prop_assert!((x - y - z).abs() < 1e-12);
            }
            // The bound of the lost information is none of a gain.
            prop_assert!(Part::cost(&a, &b) > -1e-12 && Part::cost(&a, &a).abs() < 1e-12);
        }

        #[test]
        fn a_stored_gaussian_has_its_moments(of in any_part()) {
            let stored = of.stored();
            let back = covariance(stored.quat.map(f64::from), stored.log_scales.map(|s| f64::from(s).exp()));
            let size: f64 = of.covariance[0] + of.covariance[3] + of.covariance[5];
            for (x, y) in back.into_iter().zip(of.covariance) {
                prop_assert!((x - y).abs() < 1e-5 * size, "{back:?} {:?}", of.covariance);
            }
            let mut scales = stored.log_scales.map(|s| f64::from(s).exp());
            scales.sort_by(f64::total_cmp);
            let mass = f64::from(forms::opacity(stored.opacity_logit)) * scales[1] * scales[2];
            prop_assert!((mass - of.mass.min(MOST_OPAQUE * scales[1] * scales[2])).abs() < 1e-4 * of.mass);
        }
    }

    /// A wall of small Gaussians, left dark and right bright, and a number that is none.
    fn wall() -> Gaussians {
        let at = |i: usize| [(i % 20) as f32, (i / 20) as f32, 0.0];
        let mut wall = Gaussians {
            means: (0..400).map(at).collect(),
            log_scales: vec![[-0.5, -0.5, -5.0]; 400],
            quats: vec![[1.0, 0.0, 0.0, 0.0]; 400],
            opacity_logits: vec![3.0; 400],
            sh: (0..400).flat_map(|i| [if i % 20 < 10 { -1.0 } else { 1.0 }; 3]).collect(),
            degree: 0,
        };
        wall.means[7][1] = f32::NAN;
        wall
    }

    #[test]
    fn a_wall_stays_flat_and_its_edge_sharp() {
        let merged = wall().merged(100);
        assert_eq!(merged.len(), 100);
        assert!(merged.log_scales.iter().all(|s| s.iter().copied().fold(f32::INFINITY, f32::min) < -4.9));
        // No Gaussian has a color between the two.
        assert!(merged.sh.iter().all(|x| (x.abs() - 1.0).abs() < 1e-6));
        // What is no place is not merged.
        assert_eq!(merged.means.iter().filter(|mean| mean[1].is_nan()).count(), 1);
        assert_eq!(wall().merged(0).len(), 2);
        assert_eq!(Gaussians::default().merged(5), Gaussians::default());
    }

    #[test]
    fn threads_do_not_matter() {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| wall().merged(57))
        };
        // NaN is not equal to itself.
        assert_eq!(format!("{:?}", on(1)), format!("{:?}", on(3)));
    }
}
