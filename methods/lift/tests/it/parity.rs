//! Reference numbers of all solvers: weights composited from ids and falloffs, by another program.

use crate::random::{difference, lifted, product, squares};
use weaver_fixtures::Fixture;
use weaver_lift::{Dense, Descent, LiftOptions, Operator, Solver, Stop, guide};

const SPLATS: usize = 14;
const CHANNELS: usize = 5;
const PER_RAY: usize = 4;

/// A `[rays, splats]`: per ray front to back, `alpha = min(0.99, sigma(lambda logit) falloff)`.
fn weights(file: &Fixture, lambda: f64) -> Vec<f64> {
    let mut opacities: Vec<f64> = file.f64("in.opacity_logits").iter().map(|x| 1.0 / (1.0 + (-x).exp())).collect();
    guide(&mut opacities, lambda).unwrap();
    let (ids, falloffs) = (file.f64("in.ids"), file.f64("in.falloff"));
    let mut weights = vec![0.0; ids.len() / PER_RAY * SPLATS];
    for (row, hits) in weights.chunks_exact_mut(SPLATS).zip((0..ids.len()).collect::<Vec<_>>().chunks_exact(PER_RAY)) {
        let mut light = 1.0;
        for &hit in hits.iter().filter(|hit| ids[**hit] >= 0.0) {
            let alpha = (opacities[ids[hit] as usize] * falloffs[hit]).min(0.99);
            row[ids[hit] as usize] += alpha * light;
            light *= 1.0 - alpha;
        }
    }
    weights
}

#[test]
fn solvers_equal_the_reference() {
    let file = Fixture::open("lifting.safetensors");
    let observed = file.f64("out.observed");
    for (lambda, tag) in [(1.0, ""), (1.2, "_lambda1.2"), (2.0, "_lambda2")] {
        let a = weights(&file, lambda);
        file.assert_close(&format!("out.A{tag}"), &a);
        let mut dense = Dense::new(a, SPLATS, 2).unwrap();
        let views: Vec<Vec<f64>> = observed.chunks(observed.len() / 2).map(<[f64]>::to_vec).collect();
        let mut solve = |solver| lifted(&mut dense, &views, CHANNELS, LiftOptions::with(solver));
        let row_sum = solve(Solver::RowSum);
        file.assert_close(&format!("out.D{tag}"), &row_sum.seen);
        file.assert_close(&format!("out.row_sum{tag}"), &row_sum.features);
        file.assert_close(&format!("out.squared{tag}"), &solve(Solver::Squared).features);
        file.assert_close(&format!("out.off_diagonal{tag}"), &[row_sum.coverage.off_diagonal()]);
        let mean = file.f64(&format!("out.r{tag}")).iter().sum::<f64>() / 160.0;
        assert!((row_sum.coverage.mean_alpha() - mean).abs() < 1e-6);
    }
    let a = weights(&file, 1.0);
    let mut dense = Dense::new(a.clone(), SPLATS, 1).unwrap();
    let views = [observed.clone()];
    let mut solve = |solver| lifted(&mut dense, &views, CHANNELS, LiftOptions::with(solver)).features;
    for passes in [1, 2, 5, 20] {
        file.assert_close(&format!("out.pass{passes}"), &solve(Solver::exact(passes)));
    }
    let stop = Stop { passes: 200, tolerance: 1e-14 };
    let exact = solve(Solver::Exact { descent: Descent::ConjugateGradients, stop });
    file.assert_close("out.exact", &exact);
    file.assert_close("out.damped", &solve(Solver::Damped { mu: 0.1, stop }));
    let losses: Vec<f64> = (1..=20)
        .map(|passes| squares(&difference(&product(&a, &solve(Solver::exact(passes)), SPLATS, CHANNELS), &observed)))
        .collect();
    file.assert_close("out.pass_losses", &losses);
    let row_sum = solve(Solver::RowSum);
    let drawn = |x: &[f64]| product(&a, x, SPLATS, CHANNELS);
    let loss = |x: &[f64]| squares(&difference(&drawn(x), &observed));
    let apart = squares(&difference(&drawn(&row_sum), &drawn(&exact)));
    let spread = |x: &[f64]| -> f64 {
        let of_ray = |(row, b): (&[f64], &[f64])| -> f64 {
            row.iter().zip(x.chunks_exact(CHANNELS)).map(|(a, x)| a * squares(&difference(x, b))).sum()
        };
        a.chunks_exact(SPLATS).zip(observed.chunks_exact(CHANNELS)).map(of_ray).sum()
    };
    file.assert_close("out.losses", &[loss(&row_sum), loss(&exact), apart, spread(&row_sum), spread(&exact)]);

    let planted = drawn(&file.f64("in.planted"));
    let mut dense = Dense::new(a, SPLATS, 1).unwrap();
    assert_eq!(dense.rays(0), 160);
    let found = lifted(&mut dense, &[planted], CHANNELS, LiftOptions::with(Solver::RowSum)).features;
    file.assert_close("out.planted_row_sum", &found);
}
