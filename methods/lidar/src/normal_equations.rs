//! Sums of squares of a rigid motion, and their minimum.

use crate::eigen::symmetric;
use rayon::prelude::*;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Pose, so3};

/// Residuals of one task; sums over tasks are in order.
const GRAIN: usize = 512;

/// H and b of H d = -b, for d = (dt, dw): the motion X becomes X (exp dw, dt).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NormalEquations {
    /// H, both halves.
    pub h: [[f64; 6]; 6],
    /// b
    pub b: [f64; 6],
    /// Sum of weighted squares.
    pub cost: f64,
    /// Number of residuals.
    pub count: usize,
}

/// A weighted residual with its gradients with respect to dt and dw.
pub(crate) struct Residual {
    pub error: f64,
    pub gradient: [DVec3; 2],
    pub weight: f64,
}

impl NormalEquations {
    /// The sums of `n` residuals, in a fixed order at any number of threads.
    pub(crate) fn sum(n: usize, residual: impl Fn(usize) -> Option<Residual> + Sync) -> Self {
        let part = |chunk: usize| {
            let mut sums = Self::default();
            (chunk * GRAIN..((chunk + 1) * GRAIN).min(n)).filter_map(&residual).for_each(|r| sums.add(&r));
            sums
        };
        let parts: Vec<Self> = (0..n.div_ceil(GRAIN)).into_par_iter().map(part).collect();
        let mut total = Self::default();
        for part in &parts {
            for i in 0..6 {
                (0..6).for_each(|j| total.h[i][j] += part.h[i][j]);
                total.b[i] += part.b[i];
            }
            total.cost += part.cost;
            total.count += part.count;
        }
        total
    }

    fn add(&mut self, Residual { error, gradient: [t, w], weight }: &Residual) {
        let j = [t.x, t.y, t.z, w.x, w.y, w.z];
        for row in 0..6 {
            let weighted = weight * j[row];
            (0..6).for_each(|column| self.h[row][column] += weighted * j[column]);
            self.b[row] += weighted * error;
        }
        self.cost += weight * error * error;
        self.count += 1;
    }

    /// The eigenvalues of H, ascending: the certainty along each direction.
    pub fn eigenvalues(&self) -> [f64; 6] {
        symmetric(self.h).0
    }

    /// The step d; `None` if H is singular.
    pub fn solve(&self) -> Option<[f64; 6]> {
        let (values, vectors) = symmetric(self.h);
        let determined = values[0] > 1e-9 * values[5] && values[0] > 1e-9;
        determined.then(|| {
            let mut step = [0.0; 6];
            for (value, vector) in values.iter().zip(&vectors) {
                let along: f64 = vector.iter().zip(&self.b).map(|(v, b)| v * b).sum();
                step.iter_mut().zip(vector).for_each(|(x, v)| *x -= along / value * v);
            }
            step
        })
    }
}

/// X (exp dw, dt).
pub(crate) fn moved(x: &Pose, step: [f64; 6]) -> Pose {
    let [t, w] = [DVec3::from_slice(&step[..3]), DVec3::from_slice(&step[3..])];
    let pose = x.compose(&Pose::new(so3::exp(w), t));
    // Normalizes, so that rounding does not accumulate.
    Pose::from_wxyz(pose.wxyz(), pose.translation)
}
