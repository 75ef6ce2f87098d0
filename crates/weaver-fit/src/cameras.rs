//! Cameras that are refined with the scene.

use crate::settings::Poses;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Pose, se3};

/// Numbers of a twist: translation, then rotation.
const TWIST: usize = 6;
/// Scene points that say how a camera's picture moves.
const SAMPLES: usize = 512;
/// Added to the diagonal, which is 1: directions that move no point stay finite.
const DAMPING: f64 = 1e-3;

/// A camera's pose, and Adam's moments of its twist in coordinates in which a unit moves the picture by a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefinedPose {
    /// The pose now.
    pub pose: Pose,
    pub(crate) first: [f64; TWIST],
    pub(crate) second: [f64; TWIST],
    pub(crate) steps: u64,
}

impl RefinedPose {
    /// A pose that has not moved.
    pub fn new(pose: Pose) -> Self {
        Self { pose, first: [0.0; TWIST], second: [0.0; TWIST], steps: 0 }
    }

    /// Moves against the gradient with respect to the view matrix `[3, 4]` by about `rate` pixels.
    ///
    /// The pose is `exp(twist) pose`. Twists are measured by what they do to the picture: with J the motion of projected
    /// scene points by the six numbers, `z = (J^T J / n)^(1/2) twist` moves it by |z| pixels, root mean square, and Adam runs
    /// on z. Source: Park et al., CamP: Camera Preconditioning for Neural Radiance Fields, 2023, equation 8.
    pub fn descend(&mut self, gradient: &[f32], whitening: &Whitening, rate: f64) {
        let g: [f64; 12] = std::array::from_fn(|i| f64::from(gradient[i]));
        let rows = self.pose.rows();
        let mut twist = [0.0; TWIST];
        for column in 0..4 {
            let moved = DVec3::new(rows[0][column], rows[1][column], rows[2][column]);
            let by = DVec3::new(g[column], g[4 + column], g[8 + column]);
            // The translation of a twist moves the last column alone, its rotation w moves each to w x column.
            let turn = moved.cross(by);
            for i in 0..3 {
                twist[3 + i] += turn[i];
                twist[i] += if column == 3 { by[i] } else { 0.0 };
            }
        }
        let white = whitening.gradient(&twist);
        self.steps += 1;
        let step = adam(&white, &mut self.first, &mut self.second, self.steps);
        let [a, b, c, d, e, f] = whitening.twist(&step).map(|x| -rate * x);
        self.pose = se3::exp(DVec3::new(a, b, c), DVec3::new(d, e, f)).compose(&self.pose);
    }
}

/// The direction of Adam's step: bias-corrected first moment over the root of the second.
pub(crate) fn adam<const N: usize>(g: &[f64; N], first: &mut [f64; N], second: &mut [f64; N], steps: u64) -> [f64; N] {
    let (b1, b2): (f64, f64) = (0.9, 0.99);
    let corrections = (1.0 - b1.powi(steps.min(10_000) as i32), 1.0 - b2.powi(steps.min(10_000) as i32));
    // One scale for all six: the coordinates are commensurable, and a direction without a gradient should not be taken for
    // an important one.
    let square = g.iter().map(|g| g * g).sum::<f64>() / N as f64;
    std::array::from_fn(|i| {
        first[i] = b1 * first[i] + (1.0 - b1) * g[i];
        second[i] = b2 * second[i] + (1.0 - b2) * square;
        (first[i] / corrections.0) / ((second[i] / corrections.1).sqrt() + 1e-30)
    })
}

/// Coordinates z of a camera's twist in which a unit moves its picture by a pixel: `twist = D^-1 (D^-1 A D^-1)^(-1/2) z` with
/// `A = J^T J / n` and D the roots of its diagonal, which brings lengths and angles to one unit.
#[derive(Clone, Copy, Debug)]
pub struct Whitening {
    units: [f64; TWIST],
    root: [[f64; TWIST]; TWIST],
    /// Root mean square distance of the points from the principal point, pixels.
    pub(crate) radius: f64,
}

impl Whitening {
    /// Of a camera that sees some of these points `[N, 3]`; `None` if it sees fewer than six.
    pub fn new(camera: &Camera, points: &[f32]) -> Option<Self> {
        let (mut sum, mut count, mut radius) = ([[0.0; TWIST]; TWIST], 0, 0.0);
        let stride = (points.len() / 3).div_ceil(SAMPLES).max(1);
        let k = &camera.intrinsics;
        for point in points.chunks_exact(3).step_by(stride) {
            let p = camera.pose.apply(DVec3::new(f64::from(point[0]), f64::from(point[1]), f64::from(point[2])));
            let pixel = k.project(p);
            let inside =
                (0.0..camera.width as f64).contains(&pixel.x) && (0.0..camera.height as f64).contains(&pixel.y);
            if p.z <= 0.0 || !inside {
                continue;
            }
            let (x, y) = (p.x / p.z, p.y / p.z);
            // d pixel = [f/z, 0, -f x/z] (v + w x p)
            let u = DVec3::new(k.fx / p.z, 0.0, -k.fx * x / p.z);
            let v = DVec3::new(0.0, k.fy / p.z, -k.fy * y / p.z);
            for row in [u, v] {
                let turn = p.cross(row);
                let j = [row.x, row.y, row.z, turn.x, turn.y, turn.z];
                (0..TWIST).for_each(|a| (0..TWIST).for_each(|b| sum[a][b] += j[a] * j[b]));
            }
            radius += (pixel.x - k.cx).powi(2) + (pixel.y - k.cy).powi(2);
            count += 1;
        }
        let few = count < TWIST;
        (!few).then(|| {
            sum.iter_mut().flatten().for_each(|x| *x /= count as f64);
            let units: [f64; TWIST] = std::array::from_fn(|i| sum[i][i].max(f64::MIN_POSITIVE).sqrt());
            (0..TWIST).for_each(|i| (0..TWIST).for_each(|j| sum[i][j] /= units[i] * units[j]));
            Self { units, root: inverse_root(sum), radius: (radius / count as f64).sqrt().max(1.0) }
        })
    }

    /// The gradient with respect to z of that with respect to the twist.
    fn gradient(&self, by_twist: &[f64; TWIST]) -> [f64; TWIST] {
        std::array::from_fn(|i| (0..TWIST).map(|j| self.root[i][j] * by_twist[j] / self.units[j]).sum())
    }

    fn twist(&self, z: &[f64; TWIST]) -> [f64; TWIST] {
        std::array::from_fn(|i| (0..TWIST).map(|j| self.root[i][j] * z[j]).sum::<f64>() / self.units[i])
    }
}

/// (A + damping)^(-1/2) of a symmetric matrix with a diagonal of ones, by Jacobi's rotations.
fn inverse_root(mut a: [[f64; TWIST]; TWIST]) -> [[f64; TWIST]; TWIST] {
    let mut vectors: [[f64; TWIST]; TWIST] =
        std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    for _ in 0..16 {
        for p in 0..TWIST - 1 {
            for q in p + 1..TWIST {
                if a[p][q].abs() < 1e-300 {
                    continue;
                }
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let cos = 1.0 / t.hypot(1.0);
                let sin = t * cos;
                for k in 0..TWIST {
                    (a[k][p], a[k][q]) = (cos * a[k][p] - sin * a[k][q], sin * a[k][p] + cos * a[k][q]);
                }
                for k in 0..TWIST {
                    (a[p][k], a[q][k]) = (cos * a[p][k] - sin * a[q][k], sin * a[p][k] + cos * a[q][k]);
                }
                for row in &mut vectors {
                    (row[p], row[q]) = (cos * row[p] - sin * row[q], sin * row[p] + cos * row[q]);
                }
            }
        }
    }
    let roots: [f64; TWIST] = std::array::from_fn(|k| 1.0 / (a[k][k].max(0.0) + DAMPING).sqrt());
    let entry = |i: usize, j: usize| (0..TWIST).map(|k| vectors[i][k] * roots[k] * vectors[j][k]).sum::<f64>();
    std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)))
}

impl Poses {
    /// The rate of cameras at this part of the run, pixels of a picture of this long side; 0 while they stand still.
    pub(crate) fn rate_at(&self, fraction: f64, long_side: usize) -> f64 {
        if !self.refine || fraction < self.from || fraction >= self.until {
            return 0.0;
        }
        let done = (fraction - self.from) / (self.until - self.from).max(1e-9);
        self.rate * long_side as f64 / 1000.0 * 0.01_f64.powf(done)
    }
}
