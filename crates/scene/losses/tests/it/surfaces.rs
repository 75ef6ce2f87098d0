//! Losses of surfaces against direct formulas and finite differences.

use proptest::prelude::*;
use weaver_autograd::gradcheck::Input;
use weaver_losses::{Relief, depth_loss, normal_loss};

fn between(seed: u64, low: f64, high: f64, count: usize) -> Vec<f64> {
    Input::uniform(seed, low, high, [count]).data
}

/// The gradient of a function by central differences.
fn differences(at: &[f64], value: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    const STEP: f64 = 1e-6;
    let of = |i: usize| {
        let moved = |by: f64| {
            let mut at = at.to_vec();
            at[i] += by;
            value(&at)
        };
        (moved(STEP) - moved(-STEP)) / (2.0 * STEP)
    };
    (0..at.len()).map(of).collect()
}

fn assert_close(found: &[f64], expected: &[f64]) {
    let scale = expected.iter().fold(1e-6, |m: f64, x| m.max(x.abs()));
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((a - b).abs() < 1e-6 * scale, "number {i}: {a} against {b}");
    }
}

/// A random surface as it is drawn: depth, alpha, normals.
struct Drawing {
    depth: Vec<f64>,
    alpha: Vec<f64>,
    normals: Vec<f64>,
    size: [usize; 2],
}

const INTRINSICS: [f64; 4] = [9.0, 11.0, 3.2, 2.7];

impl Drawing {
    fn new(seed: u64, size: [usize; 2]) -> Self {
        let pixels = size[0] * size[1];
        // Some stand behind the others, as beyond an edge.
        let far = between(seed ^ 5, 0.0, 1.0, pixels).into_iter().map(|x| if x > 0.9 { 1.3 } else { 1.0 });
        let depth = between(seed, 1.97, 2.03, pixels).into_iter().zip(far).map(|(z, far)| far * z).collect();
        // Some pixels are not opaque enough to count; none is at the edge of it.
        let alpha = between(!seed, 0.2, 1.0, pixels).into_iter().map(|a| if a < 0.3 { a } else { 0.6 + a / 3.0 });
        Self { depth, alpha: alpha.collect(), normals: between(seed ^ 7, -1.0, 1.0, 3 * pixels), size }
    }

    fn relief(&self) -> Relief<'_, f64> {
        let Self { depth, alpha, normals, size } = self;
        Relief { depth, alpha, normals, size: *size, intrinsics: INTRINSICS }
    }

    fn loss(&self) -> (f64, Vec<f64>, Vec<f64>) {
        let (mut of_depth, mut of_normals) = (vec![f64::NAN; self.depth.len()], vec![f64::NAN; self.normals.len()]);
        let loss = normal_loss(&self.relief(), &mut of_depth, &mut of_normals);
        (loss, of_depth, of_normals)
    }

    /// The loss by its formula.
    fn twin(&self) -> f64 {
        let [height, width] = self.size;
        let [fx, fy, cx, cy] = INTRINSICS;
        let place = |x: usize, y: usize| {
            let z = self.depth[y * width + x];
            [(x as f64 + 0.5 - cx) / fx * z, (y as f64 + 0.5 - cy) / fy * z, z]
        };
        let mut sum = 0.0;
        for y in 1..height.max(1) - 1 {
            for x in 1..width.max(1) - 1 {
                let near = [(x, y), (x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)];
                if near.iter().any(|(x, y)| self.alpha[y * width + x] < 0.5) {
                    continue;
                }
                let depths = near.map(|(x, y)| self.depth[y * width + x]);
                if depths.iter().any(|a| depths.iter().any(|b| *a > 1.05 * *b)) {
                    continue;
                }
                let [left, right, upper, lower] = [near[1], near[2], near[3], near[4]].map(|(x, y)| place(x, y));
                let [a, b] = [[right, left], [lower, upper]].map(|[p, q]| [p[0] - q[0], p[1] - q[1], p[2] - q[2]]);
                let m = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
                let length = m.iter().map(|x| x * x).sum::<f64>().sqrt();
                let at = y * width + x;
                let along: f64 = (0..3).map(|c| -m[c] / length * self.normals[3 * at + c]).sum();
                sum += self.alpha[at] - along;
            }
        }
        sum / (height * width) as f64
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 8))]

    /// Promise (fits): the loss of normals is its formula, and its gradients are those of finite differences.
    #[test]
    fn normals(seed: u64, height in 1_usize..8, width in 1_usize..40) {
        let drawing = Drawing::new(seed, [height, width]);
        let (loss, of_depth, of_normals) = drawing.loss();
        prop_assert!((loss - drawing.twin()).abs() < 1e-12);
        let Drawing { depth, alpha, normals, size } = &drawing;
        let (alpha, size) = (alpha.clone(), *size);
        let with = |depth: &[f64], normals: &[f64]| {
            Drawing { depth: depth.to_vec(), alpha: alpha.clone(), normals: normals.to_vec(), size }.twin()
        };
        assert_close(&of_depth, &differences(depth, |depth| with(depth, normals)));
        assert_close(&of_normals, &differences(normals, |normals| with(depth, normals)));
    }

    /// Promise of `normals`.
    #[test]
    fn depth(seed: u64, count in 1_usize..60, s in 0.01..0.5_f64) {
        let drawn = between(seed, 0.5, 3.0, count);
        // Some are not known.
        let known: Vec<f64> = between(!seed, 0.0, 3.0, count).into_iter().map(|d| if d < 0.5 { 0.0 } else { d }).collect();
        let twin = |drawn: &[f64]| {
            let cauchy = |d: &f64, k: &f64| 0.5 * s * (1.0 + ((d / k).ln() / s).powi(2)).ln();
            let pairs = drawn.iter().zip(&known).filter(|(_, known)| **known > 0.0);
            pairs.map(|(d, k)| cauchy(d, k)).sum::<f64>() / count as f64
        };
        let mut gradient = vec![f64::NAN; count];
        let loss = depth_loss(&drawn, &known, s, &mut gradient);
        prop_assert!((loss - twin(&drawn)).abs() < 1e-12);
        assert_close(&gradient, &differences(&drawn, twin));
    }
}

/// A plane agrees with its own normals, however it is tilted.
///
/// Promise of `normals`.
#[test]
fn a_plane_agrees_with_its_normals() {
    let size = [12, 17];
    let tilted = [0.3, -0.2, -1.0_f64];
    let length = tilted.iter().map(|x| x * x).sum::<f64>().sqrt();
    let normal = tilted.map(|x| x / length);
    let [fx, fy, cx, cy] = INTRINSICS;
    let at = |i: usize| [((i % 17) as f64 + 0.5 - cx) / fx, ((i / 17) as f64 + 0.5 - cy) / fy];
    // n . p = -2 for p = z (x, y, 1).
    let depth = (0..12 * 17).map(|i| -2.0 / (normal[0] * at(i)[0] + normal[1] * at(i)[1] + normal[2])).collect();
    let drawing = Drawing { depth, alpha: vec![1.0; 12 * 17], normals: normal.repeat(12 * 17), size };
    let (loss, of_depth, _) = drawing.loss();
    assert!(loss.abs() < 1e-12 && of_depth.iter().all(|d| d.abs() < 1e-12), "{loss}");
}
