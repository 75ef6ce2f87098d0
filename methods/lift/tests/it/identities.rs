//! Identities between the solvers, in f64, for any weights.

use crate::random::{difference, error, lifted, noise, product, solved, squares, transposed, weights};
use proptest::prelude::*;
use weaver_lift::{Dense, Descent, LiftOptions, Operator, Solver, Stop};

/// Rays, Gaussians and channels.
#[derive(Clone, Debug)]
struct Problem {
    a: Vec<f64>,
    b: Vec<f64>,
    splats: usize,
    channels: usize,
}

impl Problem {
    fn random(seed: u64, splats: usize, channels: usize, full: bool) -> Self {
        let rays = 6 * splats;
        Self { a: weights(seed, rays, splats, full), b: noise(seed, rays * channels), splats, channels }
    }

    fn rays(&self) -> usize {
        self.a.len() / self.splats
    }

    /// Features by this solver, with the rays cut into two views.
    fn solve(&self, solver: Solver) -> Vec<f64> {
        let mut dense = Dense::new(self.a.clone(), self.splats, 2).unwrap();
        let views: Vec<Vec<f64>> = self.b.chunks(self.b.len() / 2).map(<[f64]>::to_vec).collect();
        lifted(&mut dense, &views, self.channels, LiftOptions::with(solver)).features
    }

    fn drawn(&self, x: &[f64]) -> Vec<f64> {
        product(&self.a, x, self.splats, self.channels)
    }

    /// L, the loss `|A x - B|^2`.
    fn loss(&self, x: &[f64]) -> f64 {
        squares(&difference(&self.drawn(x), &self.b))
    }

    /// J
    fn spread(&self, x: &[f64]) -> f64 {
        let mut sum = 0.0;
        for (row, b) in self.a.chunks_exact(self.splats).zip(self.b.chunks_exact(self.channels)) {
            for (a, x) in row.iter().zip(x.chunks_exact(self.channels)) {
                sum += a * squares(&difference(x, b));
            }
        }
        sum
    }

    /// D
    fn seen(&self) -> Vec<f64> {
        (0..self.splats).map(|j| self.a.iter().skip(j).step_by(self.splats).sum()).collect()
    }

    /// G
    fn gram(&self) -> Vec<f64> {
        product(&transposed(&self.a, self.splats), &self.a, self.rays(), self.splats)
    }

    /// `A^T B`
    fn gathered(&self) -> Vec<f64> {
        product(&transposed(&self.a, self.splats), &self.b, self.rays(), self.channels)
    }

    fn least_squares(&self) -> Vec<f64> {
        solved(&self.gram(), &self.gathered(), self.splats, self.channels)
    }

    /// `D^-1 G x`
    fn smoothed(&self, x: &[f64]) -> Vec<f64> {
        let mut gx = product(&self.gram(), x, self.splats, self.channels);
        for (row, d) in gx.chunks_exact_mut(self.channels).zip(self.seen()) {
            row.iter_mut().for_each(|x| *x /= d);
        }
        gx
    }
}

fn converged(descent: Descent) -> Solver {
    Solver::Exact { descent, stop: Stop { passes: 10_000, tolerance: 1e-13 } }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 20, failure_persistence: None, ..Default::default() })]

    #[test]
    fn row_sum_is_the_smoothed_least_squares(seed: u64, splats in 2_usize..9, channels in 1_usize..4) {
        let mut problem = Problem::random(seed, splats, channels, false);
        let row_sum = problem.solve(Solver::RowSum);
        let best = problem.least_squares();
        prop_assert!(error(&row_sum, &problem.smoothed(&best)) < 1e-10);
        let loss = problem.loss(&best) + squares(&difference(&problem.drawn(&row_sum), &problem.drawn(&best)));
        prop_assert!((problem.loss(&row_sum) / loss - 1.0).abs() < 1e-10);
        // Row sums minimize J: with any other features it is larger by as much as they differ.
        let other = noise(seed ^ 1, splats * channels);
        let apart: f64 = problem.seen().iter().enumerate()
            .map(|(j, d)| d * squares(&difference(&row_sum[j * channels..][..channels], &other[j * channels..][..channels])))
            .sum();
        prop_assert!((problem.spread(&other) / (problem.spread(&row_sum) + apart) - 1.0).abs() < 1e-10);
        // Nothing is lost: sum D x' = sum r B.
        for c in 0..channels {
            let of_splats: f64 = problem.seen().iter().enumerate().map(|(j, d)| d * row_sum[j * channels + c]).sum();
            let of_rays: f64 = problem.a.chunks_exact(splats).zip(problem.b.chunks_exact(channels))
                .map(|(row, b)| row.iter().sum::<f64>() * b[c]).sum();
            prop_assert!((of_splats - of_rays).abs() < 1e-10 * (1.0 + of_rays.abs()));
        }
        // Planted features, for any weights.
        let planted = noise(seed ^ 2, splats * channels);
        problem.b = problem.drawn(&planted);
        prop_assert!(error(&problem.solve(Solver::RowSum), &problem.smoothed(&planted)) < 1e-10);
    }

    #[test]
    fn losses_are_bounded_where_rows_sum_to_one(seed: u64, splats in 2_usize..9, channels in 1_usize..4) {
        let problem = Problem::random(seed, splats, channels, true);
        let (row_sum, best) = (problem.solve(Solver::RowSum), problem.least_squares());
        let (loss, spread) = (problem.loss(&row_sum), problem.spread(&row_sum));
        prop_assert!(loss <= spread * (1.0 + 1e-10));
        let mut bound = 0.0;
        for (row, b) in problem.a.chunks_exact(splats).zip(problem.b.chunks_exact(channels)) {
            let distance = |j: usize| squares(&difference(&best[j * channels..][..channels], b)).sqrt();
            let mean: f64 = row.iter().enumerate().map(|(j, a)| a * distance(j)).sum();
            let variance: f64 = row.iter().enumerate().map(|(j, a)| a * (distance(j) - mean).powi(2)).sum();
            bound += (1.0 + variance / (mean * mean)) * mean * mean;
        }
        prop_assert!(spread <= bound * (1.0 + 1e-10), "{spread} {bound}");
    }

    #[test]
    fn constant_features_come_back(seed: u64, splats in 2_usize..9) {
        let mut problem = Problem::random(seed, splats, 2, false);
        problem.b = problem.b.iter().enumerate().map(|(i, _)| [0.7, -2.5][i % 2]).collect();
        for solver in [Solver::RowSum, Solver::Squared] {
            for row in problem.solve(solver).chunks_exact(2) {
                prop_assert!(error(row, &[0.7, -2.5]) < 1e-14, "{row:?}");
            }
        }
    }

    #[test]
    fn iteration_descends_to_the_least_squares(seed: u64, splats in 2_usize..7) {
        let problem = Problem::random(seed, splats, 2, false);
        prop_assert_eq!(problem.solve(Solver::exact(1)), problem.solve(Solver::RowSum));
        let mut loss = squares(&problem.b);
        for passes in 1..12 {
            let next = problem.loss(&problem.solve(Solver::exact(passes)));
            prop_assert!(next <= loss * (1.0 + 1e-12), "pass {passes}: {next} after {loss}");
            loss = next;
        }
        let best = problem.least_squares();
        for descent in [Descent::Iteration, Descent::ConjugateGradients] {
            let found = problem.solve(converged(descent));
            prop_assert!(error(&found, &best) < 1e-8, "{descent:?} {}", error(&found, &best));
        }
    }

    #[test]
    fn damping_lies_between(seed: u64, splats in 2_usize..7, mu in 0.01_f64..10.0) {
        let problem = Problem::random(seed, splats, 2, false);
        let row_sum = problem.solve(Solver::RowSum);
        let damped = |mu| problem.solve(Solver::Damped { mu, stop: Stop { passes: 200, tolerance: 1e-14 } });
        let (mut g, mut b) = (problem.gram(), problem.gathered());
        for (j, d) in problem.seen().into_iter().enumerate() {
            g[j * splats + j] += mu * d;
            (0..2).for_each(|c| b[2 * j + c] += mu * d * row_sum[2 * j + c]);
        }
        prop_assert!(error(&damped(mu), &solved(&g, &b, splats, 2)) < 1e-10);
        prop_assert!(error(&damped(1e9), &row_sum) < 1e-8);
        prop_assert!(error(&damped(0.0), &problem.least_squares()) < 1e-8);
    }
}

/// If no two Gaussians share a ray, all solvers agree.
#[test]
fn solvers_agree_without_overlap() {
    let mut problem = Problem::random(5, 6, 3, false);
    for (i, row) in problem.a.chunks_exact_mut(6).enumerate() {
        row.iter_mut().enumerate().for_each(|(j, a)| *a = if j == i % 6 { 0.1 + 0.8 * *a } else { 0.0 });
    }
    // Each Gaussian draws B times its weight, as composited over zeros.
    let planted: Vec<f64> = noise(6, 18);
    problem.b = (0..problem.rays()).flat_map(|i| planted[3 * (i % 6)..][..3].to_vec()).collect();
    let [row_sum, squared] = [Solver::RowSum, Solver::Squared].map(|solver| problem.solve(solver));
    problem.b = problem.drawn(&planted);
    let exact = problem.solve(converged(Descent::ConjugateGradients));
    for found in [row_sum, squared, exact] {
        assert!(error(&found, &planted) < 1e-10);
    }
}

/// Fewer views at a time, and fewer channels, change no bit.
#[test]
fn blocks_of_channels_change_no_bit() {
    let problem = Problem::random(9, 7, 5, false);
    let views: Vec<Vec<f64>> = problem.b.chunks(problem.b.len() / 2).map(<[f64]>::to_vec).collect();
    let stop = Stop { passes: 30, tolerance: 1e-3 };
    let solvers = [Descent::Iteration, Descent::ConjugateGradients].map(|descent| Solver::Exact { descent, stop });
    for solver in solvers.into_iter().chain([Solver::RowSum, Solver::Squared, Solver::Damped { mu: 0.1, stop }]) {
        let with_block = |block| {
            let mut dense = Dense::new(problem.a.clone(), 7, 2).unwrap();
            lifted(&mut dense, &views, 5, LiftOptions { block, ..LiftOptions::with(solver) }).features
        };
        assert_eq!(with_block(1), with_block(64), "{solver:?}");
        assert_eq!(with_block(2), with_block(64), "{solver:?}");
    }
}

#[test]
fn the_loss_and_the_coverage_are_those_of_the_matrix() {
    let problem = Problem::random(3, 5, 2, false);
    let mut dense = Dense::new(problem.a.clone(), 5, 1).unwrap();
    let options = LiftOptions { loss: true, ..LiftOptions::with(Solver::exact(3)) };
    let found = lifted(&mut dense, std::slice::from_ref(&problem.b), 2, options);
    let expected = problem.loss(&found.features) / squares(&problem.b);
    assert!((found.loss.unwrap() / expected - 1.0).abs() < 1e-12);
    assert!(error(&found.seen, &problem.seen()) < 1e-14);
    let alphas: Vec<f64> = problem.a.chunks_exact(5).map(|row| row.iter().sum()).collect();
    let coverage = found.coverage;
    assert!((coverage.mean_alpha() - alphas.iter().sum::<f64>() / alphas.len() as f64).abs() < 1e-12);
    assert!((coverage.off_diagonal() - (1.0 - squares(&problem.a) / squares(&alphas))).abs() < 1e-12);
    assert_eq!((coverage.unseen, coverage.masked, coverage.dropped, found.passes), (0, 0, 0, 3));
    assert_eq!(dense.views(), 1);
}
