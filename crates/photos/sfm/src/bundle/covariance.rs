//! Uncertainty of cameras and lenses.

mod sparse;

use super::dense::Dense;
use super::descent::{Descent, Limits};
use super::lens::NUMBERS;
use super::structure::NONE;
use super::sums::{BLOCK, PADDED};
use super::system::Row;
use super::{Bundle, TWIST};
use weaver_geometry::glam::DVec3;
use weaver_kernels::parallel;

/// Movements of the world that no observation determines: rotations, shifts and a scale.
const GAUGE: usize = 7;
/// Information of observations or priors about such a movement, over the mean of the diagonal, that counts as none.
const UNTOLD: f64 = 1e-10;
/// The determinant of a point's matrix over the cube of its trace below which the distance is undetermined: rays that
/// differ by 1e-4 radians or less.
const FAR: f64 = 1e-9;
/// Sweeps of Jacobi's method over all pairs: a guard, as it converges quadratically.
const SWEEPS: usize = 30;
/// For many cameras.
const LIMITS: Limits = Limits { profile: 200_000_000, tolerance: 1e-8, iterations: 5000, ..Limits::USUAL };

/// Standard deviations of cameras and lenses; not a number for parameters that are not adjusted.
///
/// All come from the marginal distributions, everything else unknown, up to 1000 cameras and lenses, and beyond where
/// cameras with points in common can be numbered near each other, as along a walk. Elsewhere only the lenses' do, if
/// they are at most 16; rotations and centers, and the numbers of more lenses, have the deviations that they would have
/// if all other cameras and lenses were known, which are too small.
#[derive(Clone, Debug, PartialEq)]
pub struct Covariance {
    /// Of the logarithm of the focal length, for each lens.
    pub focal: Vec<f64>,
    /// Of the first coefficient of its distortion.
    pub k1: Vec<f64>,
    /// Of the second one.
    pub k2: Vec<f64>,
    /// Of its principal point, over the longer sides of photos: the root of the sum of both variances.
    pub shift: Vec<f64>,
    /// Of the rotation of each camera, radians: the root of the sum of the variances about three axes.
    pub rotation: Vec<f64>,
    /// Of the center of each camera, world units: the root of the sum of the variances along three axes.
    pub center: Vec<f64>,
    /// Of each coordinate of a difference, in deviations.
    pub sigma: f64,
}

impl Bundle {
    /// Covariance of cameras and lenses at the end of an adjustment; `None` if observations do not determine them, or
    /// are no more than the unknowns.
    ///
    /// With J the derivatives of the differences r, all over deviations, and w their weights `1 / (1 + |r|^2 /
    /// scale^2)`, the covariance is `sigma^2 (J^T J)^-1`, where `sigma^2 = (sum w^2 |r|^2 / n) / mean(w^2)^2` over the
    /// n differences that are not used up by unknowns, and `J^T J = J^T w J / mean(w)`: the asymptotic covariance of an
    /// M-estimate. Points are unknown, too, unless they are fixed.
    ///
    /// Rotation, shift and scale of the world, as far as neither fixed cameras nor priors determine them, are left
    /// free: uncertainty in these alone does not count. Deviations are those that are left after the best movement of
    /// the world, in least squares of centers, over the root of their mean square distance from their middle, and of
    /// rotations in radians.
    ///
    /// Sources: Huber, Robust Statistics, 1981, section 7.6; Triggs et al., Bundle adjustment, a modern synthesis,
    /// 1999, section 9.
    ///
    /// ```
    /// use weaver_geometry::glam::{DMat3, DVec2, DVec3};
    /// use weaver_geometry::{Camera, Intrinsics, Pose};
    /// use weaver_sfm::{Bundle, Lens, Observation};
    ///
    /// // Four cameras around a block of 27 points, what they see off by half a pixel to and fro.
    /// let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 50.0, cy: 50.0 };
    /// let camera = |i: usize| {
    ///     let pose = Pose::new(DMat3::from_rotation_y(0.3 * i as f64), DVec3::new(0.0, 0.0, 5.0));
    ///     Camera { pose, intrinsics, width: 100, height: 100 }
    /// };
    /// let points: Vec<DVec3> = (0..27).map(|i| [i % 3, i / 3 % 3, i / 9].map(|k| f64::from(k) - 1.0).into()).collect();
    /// let lens = Lens { free_focal: true, ..Lens::default() };
    /// let mut bundle = Bundle {
    ///     cameras: (0..4).map(camera).collect(),
    ///     points,
    ///     lenses: vec![lens],
    ///     lens_of: vec![0; 4],
    ///     fixed: vec![false; 4],
    ///     ..Bundle::default()
    /// };
    /// for (point, at) in bundle.points.iter().enumerate() {
    ///     for (number, camera) in bundle.cameras.iter().enumerate() {
    ///         let noise = 0.5 * DVec2::new((7 * point + 3 * number) as f64, (5 * point + number) as f64).map(f64::sin);
    ///         let pixel = lens.project(camera, camera.pose.apply(*at)) + noise;
    ///         bundle.observations.push(Observation { camera: number, point, pixel, deviation: 1.0 });
    ///     }
    /// }
    /// assert!(bundle.adjust(4.0, 50).converged);
    /// let known = bundle.covariance(4.0).expect("more is seen than is unknown");
    /// // The noise shows in the differences, and what is adjusted is known only so far.
    /// assert!((0.2..0.5).contains(&known.sigma) && known.focal[0] > 0.001, "{known:?}");
    /// assert!(known.rotation.iter().all(|radians| (1e-4..0.1).contains(radians)), "{known:?}");
    /// // Distortion was held.
    /// assert!(known.k1[0].is_nan());
    /// ```
    pub fn covariance(&self, scale: f64) -> Option<Covariance> {
        self.covariance_within(scale, &LIMITS)
    }

    pub(super) fn covariance_within(&self, scale: f64, limits: &Limits) -> Option<Covariance> {
        let mut bundle = self.clone();
        let mut held = bundle.agreed();
        loop {
            if !bundle.fixed_points {
                bundle.observations.retain(|o| held[o.point]);
            }
            // Neither a dense factor nor a profile is needed here: nothing is solved yet.
            let mut descent = Descent::new(&bundle, scale, &Limits { dense: 0, profile: 0, ..*limits });
            if !descent.linearize().is_finite() {
                return None;
            }
            descent.reduce(0.0);
            // Where next to nothing determines the distance of a point, its part of the equations is lost in rounding.
            let mut lost = false;
            for part in &descent.parts {
                let far = |point: u32| part.matrix.get(point as usize).is_some_and(|m| !tells_distance(m));
                for o in part.seen.iter().filter(|o| far(o.point)) {
                    held[part.numbers[o.point as usize] as usize] = false;
                    lost = true;
                }
            }
            if !lost {
                return Inner::new(&descent, &bundle).covariance(scale, limits);
            }
        }
    }

    /// The variance of differences, and the factor on inverses of the equations.
    fn noise(&self, scale: f64, unknowns: usize) -> Option<[f64; 2]> {
        let (mut squares, mut once, mut twice) = (0.0, 0.0, 0.0);
        for (error, o) in self.errors().into_iter().zip(&self.observations).filter(|(error, _)| error.is_finite()) {
            let r = error / o.deviation;
            let weight = 1.0 / (1.0 + (r / scale).powi(2));
            squares += (weight * r).powi(2);
            once += weight;
            twice += weight * weight;
        }
        let n = self.observations.len() as f64;
        // Two coordinates each.
        let left = 2.0 * n - unknowns as f64;
        let variance = squares / left * (n / twice).powi(2);
        (left > 0.0 && variance.is_finite()).then_some([variance, variance * once / n])
    }
}

/// The equations with lengths measured in the size of the world.
struct Inner<'a> {
    descent: &'a Descent<'a>,
    bundle: &'a Bundle,
    /// Root of the mean square distance of centers from their middle.
    size: f64,
    middle: DVec3,
}

impl<'a> Inner<'a> {
    fn new(descent: &'a Descent<'a>, bundle: &'a Bundle) -> Self {
        let free = (0..bundle.cameras.len()).filter(|i| descent.blocks.of_camera[*i] != NONE && bundle.leads(*i));
        let centers: Vec<DVec3> = free.map(|i| bundle.cameras[i].pose.center()).collect();
        let n = centers.len().max(1) as f64;
        let middle = centers.iter().sum::<DVec3>() / n;
        let size = (centers.iter().map(|c| c.distance_squared(middle)).sum::<f64>() / n).sqrt();
        Self { descent, bundle, size: if size > 0.0 { size } else { 1.0 }, middle }
    }

    fn covariance(&self, scale: f64, limits: &Limits) -> Option<Covariance> {
        let Descent { blocks, system, parts, .. } = self.descent;
        let gauge = self.gauge();
        let unknown = |row: usize, k: usize| k < BLOCK && system.matrix[row].0[k][k] > 0.0;
        let numbers = (0..blocks.count).map(|row| (0..BLOCK).filter(|k| unknown(row, *k)).count()).sum::<usize>();
        let points: usize = parts.iter().flat_map(|p| p.matrix.iter()).filter(|m| m[0] > 0.0).count();
        let [variance, factor] = self.bundle.noise(scale, numbers + 3 * points - gauge.len())?;
        let mut of =
            if blocks.count <= limits.dense { self.marginal(&gauge)? } else { self.marginal_of_many(&gauge, limits)? };
        for (row, of) in of.iter_mut().enumerate() {
            (0..BLOCK).filter(|k| !unknown(row, *k)).for_each(|k| of[k] = f64::NAN);
        }
        let deviation = |block: u32, numbers: std::ops::Range<usize>| {
            if block == NONE { f64::NAN } else { (factor * of[block as usize][numbers].iter().sum::<f64>()).sqrt() }
        };
        let lens = |first: usize, end: usize| blocks.of_lens.iter().map(|b| deviation(*b, first..end)).collect();
        let camera = |first: usize| blocks.of_camera.iter().map(move |b| deviation(*b, first..first + 3));
        Some(Covariance {
            focal: lens(0, 1),
            k1: lens(1, 2),
            k2: lens(2, 3),
            shift: lens(3, NUMBERS),
            rotation: camera(3).collect(),
            center: camera(0).map(|x| x * self.size).collect(),
            sigma: variance.sqrt(),
        })
    }

    /// Unit of a number of a block.
    fn unit(&self, block: usize, k: usize) -> f64 {
        if k < TWIST / 2 && self.descent.blocks.is_camera(block) { self.size } else { 1.0 }
    }

    /// The movements of the world that nothing determines, orthonormal.
    fn gauge(&self) -> Vec<Vec<f64>> {
        let Descent { blocks, reduced, .. } = self.descent;
        let mut all: Vec<Vec<f64>> = vec![vec![0.0; BLOCK * blocks.count]; GAUGE];
        for (number, camera) in self.bundle.cameras.iter().enumerate() {
            let block = blocks.of_camera[number];
            if block == NONE || !self.bundle.leads(number) {
                continue;
            }
            let turn = camera.pose.rotation;
            // From the middle, in coordinates of the camera.
            let to = (camera.pose.translation + turn * self.middle) / self.size;
            let mut put = |number: usize, v: DVec3, w: DVec3| {
                let at = &mut all[number][BLOCK * block as usize..][..BLOCK];
                at.copy_from_slice(&[v.x, v.y, v.z, w.x, w.y, w.z]);
            };
            for (k, axis) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
                let axis = turn * axis;
                put(k, -axis, DVec3::ZERO);
                put(3 + k, axis.cross(to), -axis);
            }
            put(6, to, DVec3::ZERO);
        }
        let mut basis: Vec<Vec<f64>> = Vec::new();
        for mut x in all {
            let before = dot(&x, &x);
            // Twice, so that rounding leaves nothing of the others.
            for other in basis.iter().chain(&basis) {
                let by = dot(&x, other);
                x.iter_mut().zip(other).for_each(|(x, o)| *x -= by * o);
            }
            let after = dot(&x, &x);
            if after > 1e-12 * before {
                x.iter_mut().for_each(|x| *x /= after.sqrt());
                basis.push(x);
            }
        }
        let products: Vec<Vec<f64>> = basis.iter().map(|x| self.product(x)).collect();
        let told = basis.iter().map(|a| products.iter().map(|b| dot(a, b)).collect()).collect();
        let (values, vectors) = eigen(told);
        let least = UNTOLD * self.mean();
        let untold = values.into_iter().zip(vectors).filter(|(value, _)| value.abs() < least);
        let combine = |by: Vec<f64>| {
            let mut sum = vec![0.0; BLOCK * reduced.rows];
            for (x, by) in basis.iter().zip(by) {
                sum.iter_mut().zip(x).for_each(|(sum, x)| *sum += by * x);
            }
            sum
        };
        untold.map(|(_, by)| combine(by)).collect()
    }

    /// The mean of the diagonal.
    fn mean(&self) -> f64 {
        let reduced = &self.descent.reduced;
        let diagonal = |row: usize, k: usize| {
            reduced.row(row).1.last().map_or(0.0, |block| block.0[k][k] * self.unit(row, k).powi(2))
        };
        let cameras = || (0..reduced.rows).filter(|row| self.descent.blocks.is_camera(*row));
        let sum: f64 = cameras().flat_map(|row| (0..BLOCK).map(move |k| diagonal(row, k))).sum();
        sum / (BLOCK * cameras().count()).max(1) as f64
    }

    /// The product of the matrix and a vector.
    fn product(&self, x: &[f64]) -> Vec<f64> {
        let reduced = &self.descent.reduced;
        let mut y = vec![0.0; x.len()];
        for row in 0..reduced.rows {
            let (columns, blocks) = reduced.row(row);
            for (column, block) in columns.iter().map(|c| *c as usize).zip(blocks) {
                for a in 0..BLOCK {
                    for b in 0..BLOCK {
                        let value = block.0[a][b] * self.unit(row, a) * self.unit(column, b);
                        y[BLOCK * row + a] += value * x[BLOCK * column + b];
                        if column != row {
                            y[BLOCK * column + b] += value * x[BLOCK * row + a];
                        }
                    }
                }
            }
        }
        y
    }

    /// The diagonal of the inverse, without the movements that nothing determines: with G those, orthonormal, the
    /// pseudo-inverse of S is `(S + a G G^T)^-1 - G G^T / a`.
    fn marginal(&self, gauge: &[Vec<f64>]) -> Option<Vec<Row>> {
        let reduced = &self.descent.reduced;
        let mut dense = Dense::new(BLOCK * reduced.rows);
        let weight = self.mean();
        for row in 0..reduced.rows {
            let (columns, blocks) = reduced.row(row);
            for (column, block) in columns.iter().map(|c| *c as usize).zip(blocks) {
                dense.add(row, column, |a, b| block.0[a][b] * self.unit(row, a) * self.unit(column, b));
            }
            for g in gauge {
                let of = |row: usize, a: usize| g[BLOCK * row + a];
                (0..=row).for_each(|column| dense.add(row, column, |a, b| weight * of(row, a) * of(column, b)));
            }
        }
        if !dense.factor() {
            return None;
        }
        let mut inverse = vec![[0.0; PADDED]; reduced.rows];
        parallel::for_chunks(&mut inverse, 1, |row, inverse| {
            let mut x = vec![0.0; BLOCK * reduced.rows];
            for (k, inverse) in inverse[0].iter_mut().enumerate().take(BLOCK) {
                let at = BLOCK * row + k;
                let untold: f64 = gauge.iter().map(|g| g[at] * g[at]).sum();
                *inverse = dense.inverse_diagonal(at, &mut x) - untold / weight;
            }
        });
        Some(inverse)
    }
}

/// True if the matrix of a point determines its distance: its determinant is too large for rounding, so that three
/// directions are measured.
fn tells_distance([xx, xy, xz, yy, yz, zz]: &[f64; 6]) -> bool {
    let determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
    determinant > FAR * (xx + yy + zz).powi(3)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Eigenvalues and eigenvectors of a small symmetric matrix, by Jacobi's method.
fn eigen(mut m: Vec<Vec<f64>>) -> (Vec<f64>, Vec<Vec<f64>>) {
    let n = m.len();
    let mut vectors: Vec<Vec<f64>> = (0..n).map(|i| (0..n).map(|j| f64::from(i == j)).collect()).collect();
    for _ in 0..SWEEPS {
        for (p, q) in (0..n).flat_map(|p| (p + 1..n).map(move |q| (p, q))) {
            if m[p][q] == 0.0 {
                continue;
            }
            let angle = 0.5 * (2.0 * m[p][q]).atan2(m[q][q] - m[p][p]);
            let (sin, cos) = angle.sin_cos();
            for row in &mut m {
                (row[p], row[q]) = (cos * row[p] - sin * row[q], sin * row[p] + cos * row[q]);
            }
            for rows in [&mut m, &mut vectors] {
                let (upper, lower) = rows.split_at_mut(q);
                for (a, b) in upper[p].iter_mut().zip(&mut lower[0]) {
                    (*a, *b) = (cos * *a - sin * *b, sin * *a + cos * *b);
                }
            }
        }
    }
    ((0..n).map(|i| m[i][i]).collect(), vectors)
}
