//! Families of paths that are linear in their numbers, and least squares on them.

use super::frames::{FRAMES, seen, time};

/// Frames between two keys, and cycles in a clip.
const INTERVAL: usize = 12;
const CYCLES: f64 = 4.0;

#[derive(Clone, Copy)]
pub enum Family {
    Cubic,
    /// Cubic Hermite splines with Catmull-Rom slopes.
    Keys,
    Waves,
}

impl Family {
    /// The family of an expert's paths.
    pub fn named(expert: &str) -> Self {
        match expert {
            "Poly" => Self::Cubic,
            "Keys" => Self::Keys,
            "Code" => Self::Waves,
            other => panic!("an expert with a family of paths, found {other}"),
        }
    }

    /// Factors on the numbers of a path at a time.
    pub fn basis(self, t: f64) -> Vec<f64> {
        match self {
            Self::Cubic => {
                let x = 2.0 * t - 1.0;
                vec![1.0, x, 2.0 * x * x - 1.0, 4.0 * x * x * x - 3.0 * x]
            }
            Self::Waves => {
                let (sin, cos) = (std::f64::consts::TAU * CYCLES * t).sin_cos();
                vec![1.0, sin, cos]
            }
            Self::Keys => {
                let x = t * FRAMES as f64 / INTERVAL as f64;
                let (key, d) = (x as usize, x - x.floor());
                let (d2, d3) = (d * d, d * d * d);
                // One key before the first.
                let mut all = vec![0.0; FRAMES / INTERVAL + 3];
                let slopes = [(d3 - 2.0 * d2 + d) / 2.0, (d3 - d2) / 2.0];
                all[key] -= slopes[0];
                all[key + 1] += 2.0 * d3 - 3.0 * d2 + 1.0 - slopes[1];
                all[key + 2] += 3.0 * d2 - 2.0 * d3 + slopes[0];
                all[key + 3] += slopes[1];
                all
            }
        }
    }

    /// Least squares of paths `[F][N, 3]` on the seen frames, evaluated at all frames.
    pub fn fitted(self, truth: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let basis: Vec<Vec<f64>> = (0..FRAMES).map(|frame| self.basis(time(frame))).collect();
        // Only numbers that some seen frame determines.
        let used: Vec<usize> =
            (0..basis[0].len()).filter(|i| (0..FRAMES).any(|frame| seen(frame) && basis[frame][*i] != 0.0)).collect();
        let of = |frame: usize| used.iter().map(|i| basis[frame][*i]).collect::<Vec<_>>();
        let rows: Vec<Vec<f64>> = (0..FRAMES).map(of).collect();
        let numbers = |coordinate: usize| {
            let m = used.len();
            let mut system = vec![vec![0.0; m + 1]; m];
            for frame in (0..FRAMES).filter(|frame| seen(*frame)) {
                for (to, b) in system.iter_mut().zip(&rows[frame]) {
                    to.iter_mut().zip(&rows[frame]).for_each(|(to, other)| *to += b * other);
                    to[m] += b * truth[frame][coordinate];
                }
            }
            solved(system)
        };
        let numbers: Vec<Vec<f64>> = (0..truth[0].len()).map(numbers).collect();
        let at = |row: &Vec<f64>| {
            numbers.iter().map(|own| own.iter().zip(row).map(|(x, b)| x * b).sum::<f64>()).collect::<Vec<_>>()
        };
        rows.iter().map(at).collect()
    }
}

/// Solves a positive definite system with the right side in its last column.
fn solved(mut rows: Vec<Vec<f64>>) -> Vec<f64> {
    let n = rows.len();
    for i in 0..n {
        let pivot = rows[i].clone();
        for (j, row) in rows.iter_mut().enumerate().filter(|(j, _)| *j != i) {
            let factor = row[i] / pivot[i];
            assert!(factor.is_finite(), "numbers {i} and {j} depend on one another");
            row.iter_mut().zip(&pivot).for_each(|(x, p)| *x -= factor * p);
        }
    }
    (0..n).map(|i| rows[i][n] / rows[i][i]).collect()
}
