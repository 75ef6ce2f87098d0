//! Depth brought to points: recovery, robustness, and a slow twin.

use proptest::prelude::*;
use weaver_inference::{SeenPoint, depth_to_points};
use weaver_kernels::random::Stream;

const SIZE: [usize; 2] = [24, 32];
const PLANE: usize = SIZE[0] * SIZE[1];

/// Depth of views from 1 to about 3 that changes slowly across the image.
fn depth(views: usize, seed: u64) -> Vec<f32> {
    let random = Stream::new(seed, 0, "test.depth");
    let value = |i: usize| {
        let (v, x, y) = ((i / PLANE) as u64, (i % SIZE[1]) as f64, (i / SIZE[1] % SIZE[0]) as f64);
        let [a, b]: [f64; 2] = std::array::from_fn(|k| random.uniform(2 * v + k as u64));
        (1.5 + 0.5 * (0.2 * x + 6.0 * a).sin() + 0.8 * b * y / SIZE[0] as f64) as f32
    };
    (0..views * PLANE).map(value).collect()
}

/// `count` points in each view, at centers of pixels, with depth `z(view, number, network's depth)`.
fn seen(depth: &[f32], counts: &[usize], seed: u64, z: impl Fn(usize, usize, f64) -> f64) -> Vec<Vec<SeenPoint>> {
    let random = Stream::new(seed, 0, "test.points");
    let view = |(v, count): (usize, &usize)| {
        let point = |i: usize| {
            let at = random.fork(v as u64).below(i as u64, PLANE);
            let pixel = [(at % SIZE[1]) as f64 + 0.5, (at / SIZE[1]) as f64 + 0.5];
            SeenPoint { pixel, depth: z(v, i, f64::from(depth[v * PLANE + at])) }
        };
        (0..*count).map(point).collect()
    };
    counts.iter().enumerate().map(view).collect()
}

/// The largest difference of L from `expected(view, ln d)`.
fn off(depth: &[f32], seen: &[Vec<SeenPoint>], expected: impl Fn(usize, f64) -> f64) -> f64 {
    let found = depth_to_points(depth, SIZE, seen).log_factors;
    let at = |(i, l): (usize, &f32)| (f64::from(*l) - expected(i / PLANE, f64::from(depth[i]).ln())).abs();
    found.iter().enumerate().map(at).fold(0.0, f64::max)
}

#[test]
fn one_factor_comes_back_from_any_number_of_points() {
    let depth = depth(3, 1);
    for counts in [[1, 0, 0], [4, 5, 11], [200, 12, 3]] {
        let seen = seen(&depth, &counts, 2, |_, _, d| 1.7 * d);
        assert!(off(&depth, &seen, |_, _| 1.7_f64.ln()) < 1e-6);
    }
}

#[test]
fn factors_of_views_come_back() {
    let depth = depth(3, 3);
    let factors = [0.8_f64, 1.0, 1.5];
    let seen = seen(&depth, &[300; 3], 4, |v, _, d| factors[v] * d);
    assert!(off(&depth, &seen, |v, _| factors[v].ln()) < 2e-3);
}

#[test]
fn lines_in_the_logarithm_of_depth_come_back() {
    let depth = depth(2, 5);
    let line = |v: usize, log_depth: f64| [0.3, -0.2][v] + [-0.4, 0.25][v] * log_depth;
    let seen = seen(&depth, &[400; 2], 6, |v, _, d| d * line(v, d.ln()).exp());
    assert!(off(&depth, &seen, line) < 0.02);
}

#[test]
fn a_fifth_of_gross_outliers_changes_little() {
    let depth = depth(2, 7);
    let line = |log_depth: f64| 0.3 - 0.2 * log_depth;
    let wrong = [0.1, 10.0];
    let seen =
        seen(&depth, &[300; 2], 8, |_, i, d| if i % 5 == 0 { d * wrong[i / 5 % 2] } else { d * line(d.ln()).exp() });
    let found = depth_to_points(&depth, SIZE, &seen).log_factors;
    let errors: Vec<f64> =
        found.iter().zip(&depth).map(|(l, d)| (f64::from(*l) - line(f64::from(*d).ln())).abs()).collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    assert!(mean < 0.1, "{mean}");
    // Outliers affect only their own surroundings, within 0.5.
    assert!(errors.iter().all(|error| *error < 0.5));
}

#[test]
fn few_points_are_corrected_as_all_views_together() {
    let depth = depth(3, 9);
    let seen = seen(&depth, &[4, 0, 50], 10, |v, i, d| d * if v == 0 { 3.0 + i as f64 } else { 2.0 });
    let found = depth_to_points(&depth, SIZE, &seen);
    assert_eq!(found.points, [4, 0, 50]);
    assert!(found.log_factors[..2 * PLANE].iter().all(|l| (l - 2f32.ln()).abs() < 1e-6));
}

#[test]
fn no_points_leave_depth_as_it_is() {
    let depth = depth(2, 11);
    let found = depth_to_points(&depth, SIZE, &[Vec::new(), Vec::new()]);
    assert!(found.factors().iter().all(|f| *f == 1.0));
    assert_eq!(found.points, [0, 0]);
}

#[test]
fn corrections_end_at_a_limit() {
    let depth = depth(2, 13);
    for (factor, limit) in [(100.0, 1.5), (0.01, -1.5)] {
        for counts in [[2, 0], [30, 9]] {
            let seen = seen(&depth, &counts, 14, |_, _, d| factor * d);
            assert!(depth_to_points(&depth, SIZE, &seen).log_factors.iter().all(|l| *l == limit));
        }
    }
}

#[test]
fn what_is_no_number_does_not_count() {
    let mut depth = depth(1, 15);
    for (i, wrong) in [f32::NAN, f32::INFINITY, 0.0, -1.0].into_iter().enumerate() {
        depth[100 * i] = wrong;
    }
    let good = seen(&depth, &[60], 16, |_, _, d| 2.0 * d);
    let mut all = good.clone();
    for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1.0, 0.0, 1e300] {
        all[0].push(SeenPoint { pixel: [wrong, 3.5], depth: 1.0 });
        all[0].push(SeenPoint { pixel: [3.5, wrong], depth: 1.0 });
        all[0].push(SeenPoint { pixel: [3.5, 3.5], depth: wrong });
    }
    all[0].retain(|point| !(point.pixel == [0.0, 3.5] || point.pixel == [3.5, 0.0] || point.depth == 1e300));
    let (good, all) = (depth_to_points(&depth, SIZE, &good), depth_to_points(&depth, SIZE, &all));
    assert!(all.log_factors.iter().all(|l| (l - 2f32.ln()).abs() < 1e-6));
    assert!(good.points[0] == all.points[0] && good.points[0] >= 56);
    let nothing = depth_to_points(&vec![f32::NAN; PLANE], SIZE, &[vec![SeenPoint { pixel: [3.5; 2], depth: 1.0 }; 20]]);
    assert!(nothing.log_factors.iter().all(|l| *l == 0.0));
}

/// Rows of weights and an unknown line, as one writes them down: [`depth_to_points`] without any sharing.
fn slowly(depth: &[f32], seen: &[Vec<SeenPoint>]) -> Vec<f64> {
    let log = |v: usize, x: f64, y: f64| f64::from(depth[v * PLANE + y as usize * SIZE[1] + x as usize]).ln();
    let median = |mut all: Vec<f64>| {
        all.sort_by(f64::total_cmp);
        if all.is_empty() { 0.0 } else { (all[(all.len() - 1) / 2] + all[all.len() / 2]) / 2.0 }
    };
    let errors =
        |v: usize| -> Vec<f64> { seen[v].iter().map(|p| p.depth.ln() - log(v, p.pixel[0], p.pixel[1])).collect() };
    let global = median((0..seen.len()).flat_map(errors).collect());
    let mut all = Vec::new();
    for (v, points) in seen.iter().enumerate() {
        let (n, errors) = (points.len() as f64, errors(v));
        let logs: Vec<f64> = points.iter().map(|p| log(v, p.pixel[0], p.pixel[1])).collect();
        let a = (n * median(errors.clone()) + 5.0 * global) / (n + 5.0);
        let mean = logs.iter().sum::<f64>() / n;
        let deviation = (logs.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / n).sqrt();
        let s = |l: f64| ((l - mean) / (deviation + 0.05)).clamp(-3.0, 3.0);
        let mut q = [0.0; 2];
        for _ in 0..if n >= 12.0 { 5 } else { 0 } {
            let row = |(l, e): (&f64, &f64)| {
                let w = 1.0 / (1.0 + ((e - a - q[0] - q[1] * s(*l)) / 0.1).powi(2)).sqrt();
                [w, w * s(*l), w * (e - a)]
            };
            let mut rows: Vec<[f64; 3]> = logs.iter().zip(&errors).map(row).collect();
            rows.extend([[1.0, 0.0, 0.0], [0.0, 5f64.sqrt(), 0.0]]);
            let dot = |i: usize, j: usize| rows.iter().map(|row| row[i] * row[j]).sum::<f64>();
            let determinant = dot(0, 0) * dot(1, 1) - dot(0, 1).powi(2);
            q = [
                (dot(0, 2) * dot(1, 1) - dot(0, 1) * dot(1, 2)) / determinant,
                (dot(0, 0) * dot(1, 2) - dot(0, 1) * dot(0, 2)) / determinant,
            ];
        }
        for i in 0..PLANE {
            let (x, y) = ((i % SIZE[1]) as f64 + 0.5, (i / SIZE[1]) as f64 + 0.5);
            let line = |l: f64| a + q[0] + q[1] * s(l);
            let (mut sum, mut weights) = (0.0, 0.0);
            for ((p, l), e) in points.iter().zip(&logs).zip(&errors) {
                let squared = (p.pixel[0] - x).powi(2) + (p.pixel[1] - y).powi(2);
                let w = (-squared / 50.0).exp() * (-(log(v, x, y) - l).powi(2) / 0.125).exp();
                sum += w * (e - line(*l)).clamp(-0.5, 0.5);
                weights += w;
            }
            let log_factor = if n < 5.0 { global } else { line(log(v, x, y)) + sum / (1.0 + weights) };
            all.push(log_factor.clamp(-1.5, 1.5));
        }
    }
    all
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 8, failure_persistence: None, ..Default::default() })]

    #[test]
    fn equal_to_the_slow_twin_in_any_order(counts in prop::collection::vec(0usize..80, 1..4), seed in any::<u64>()) {
        let depth = depth(counts.len(), seed);
        let noise = Stream::new(seed, 0, "test.noise");
        let z = |v: usize, i: usize, d: f64| {
            d * (0.4 * noise.fork(v as u64).normal::<f64>(i as u64) + 0.2 * v as f64).exp()
        };
        let mut seen = seen(&depth, &counts, seed, z);
        let found = depth_to_points(&depth, SIZE, &seen);
        for (a, b) in found.log_factors.iter().zip(slowly(&depth, &seen)) {
            prop_assert!((f64::from(*a) - b).abs() < 1e-6, "{a} {b}");
        }
        for (v, view) in seen.iter_mut().enumerate() {
            noise.fork(v as u64 + 100).shuffle(view);
        }
        for (a, b) in found.log_factors.iter().zip(depth_to_points(&depth, SIZE, &seen).log_factors) {
            prop_assert!((a - b).abs() < 1e-6, "{a} {b}");
        }
    }
}
