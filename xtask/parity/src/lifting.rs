//! Lifting of features: weights composited along rays, all solvers, guidance.

use super::reference::Reference;
use weaver_autograd::Real;
use weaver_lift::{
    Dense, Descent, HdbscanOptions, LiftOptions, Lifted, Maps, Operator, Pca, Solver, Stop, guide, hdbscan, lift,
};

pub fn run<T: Real>(file: Reference) -> Reference {
    let (splats, channels) = (file.size("splats"), file.size("channels"));
    let observed: Vec<T> = file.data("out.observed");
    file.check("out.observed", &with_noise(&file, &weights::<T>(&file, 1.0), splats, channels));
    let lifted = |a: &[T], observed: &[T], solver: Solver| -> Lifted<T> {
        let mut dense = Dense::new(a.to_vec(), splats, 1).unwrap_or_else(|e| panic!("{e}"));
        let mut maps = Maps { views: vec![observed.to_vec()], channels };
        let options = LiftOptions { least_alpha: None, ..LiftOptions::with(solver) };
        lift(&mut dense, &mut maps, &options, &mut || ()).unwrap_or_else(|e| panic!("{e}"))
    };
    for (lambda, tag) in [(1.0, ""), (1.2, "_lambda1.2"), (2.0, "_lambda2")] {
        let a = weights::<T>(&file, lambda);
        let row_sum = lifted(&a, &observed, Solver::RowSum);
        file.check(&format!("out.A{tag}"), &a);
        file.check(
            &format!("out.r{tag}"),
            &a.chunks_exact(splats).map(|row| row.iter().copied().sum()).collect::<Vec<T>>(),
        );
        file.check(&format!("out.D{tag}"), &row_sum.seen);
        file.check(&format!("out.row_sum{tag}"), &row_sum.features);
        file.check(&format!("out.squared{tag}"), &lifted(&a, &observed, Solver::Squared).features);
        file.check(&format!("out.off_diagonal{tag}"), &[T::from_f64(row_sum.coverage.off_diagonal())]);
    }
    let a = weights::<T>(&file, 1.0);
    let solved = |solver| lifted(&a, &observed, solver).features;
    for passes in file.sizes("passes") {
        file.check(&format!("out.pass{passes}"), &solved(Solver::exact(passes)));
    }
    let stop = Stop { passes: 300, tolerance: 1e-9 };
    let exact = solved(Solver::Exact { descent: Descent::ConjugateGradients, stop });
    let damped = solved(Solver::Damped { mu: file.number("damping"), stop });
    let row_sum = solved(Solver::RowSum);
    file.check("out.exact", &exact);
    file.check("out.damped", &damped);
    let planted = drawn(&a, &file.data::<T>("in.planted"), splats, channels);
    file.check("out.planted_row_sum", &lifted(&a, &planted, Solver::RowSum).features);
    // The Gram matrix, column by column.
    let mut identity = vec![T::ZERO; splats * splats];
    (0..splats).for_each(|j| identity[j * splats + j] = T::ONE);
    file.check("out.gram", &gathered(&a, &drawn(&a, &identity, splats, splats), splats, splats));

    let loss = |a: &[T], x: &[T], b: &[T]| squares(&difference(&drawn(a, x, splats, channels), b));
    let last = file.sizes("passes").into_iter().max().unwrap_or(0);
    let of_passes: Vec<T> = (1..=last).map(|k| T::from_f64(loss(&a, &solved(Solver::exact(k)), &observed))).collect();
    file.check("out.pass_losses", &of_passes);
    let apart = squares(&difference(&drawn(&a, &row_sum, splats, channels), &drawn(&a, &exact, splats, channels)));
    let of = |x: &[T]| loss(&a, x, &observed);
    let spreads = [&row_sum, &exact].map(|x| weighted(&a, x, &observed, splats, channels, |d| d * d));
    file.check("out.losses", &[of(&row_sum), of(&exact), apart, spreads[0], spreads[1]].map(T::from_f64));

    let mut full = a;
    for row in full.chunks_exact_mut(splats) {
        let sum = row.iter().copied().sum::<T>();
        row.iter_mut().for_each(|x| *x = if sum > T::ZERO { *x / sum } else { T::ZERO });
    }
    let row_sum = lifted(&full, &observed, Solver::RowSum).features;
    let exact = lifted(&full, &observed, Solver::Exact { descent: Descent::ConjugateGradients, stop }).features;
    let (mut bound, mut beta) = (0.0, 0.0_f64);
    for (row, b) in full.chunks_exact(splats).zip(observed.chunks_exact(channels)) {
        let mean = weighted(row, &exact, b, splats, channels, |d| d);
        let variance = weighted(row, &exact, b, splats, channels, |d| d * d) - mean * mean;
        bound += variance + mean * mean;
        beta = beta.max(variance / (mean * mean).max(1e-30));
    }
    let spread = weighted(&full, &row_sum, &observed, splats, channels, |d| d * d);
    let of = |x: &[T]| loss(&full, x, &observed);
    file.check("out.bound", &[of(&row_sum), spread, bound, of(&exact), beta].map(T::from_f64));
    file
}

/// Principal components and clusters of points.
pub fn clusters<T: Real>(file: Reference) -> Reference {
    let points: Vec<T> = file.data("in.points");
    let pca = Pca::of(&points, 12, file.size("components"));
    let numbers = |values: &[f64]| -> Vec<T> { values.iter().map(|x| T::from_f64(*x)).collect() };
    file.check("out.pca.mean", &numbers(&pca.mean));
    file.check("out.pca.axes", &numbers(&pca.axes));
    file.check("out.pca.variances", &numbers(&pca.variances));
    file.check("out.pca.projected", &numbers(&pca.project(&points)));
    let keys: Vec<String> = file.keys().filter(|key| key.starts_with("out.labels.")).map(String::from).collect();
    for key in keys {
        let parts: Vec<&str> = key.split('.').collect();
        let number = |at: usize| parts[at].parse().unwrap_or_else(|e| panic!("{key}: {e}"));
        let options = HdbscanOptions { smallest: number(3), samples: number(4), resolution: 0.0 };
        let points: Vec<f64> = file.data(&format!("in.{}", parts[2]));
        let labels = hdbscan(&points, file.size(&format!("sets.{}", parts[2])), &options);
        let found: Vec<T> = labels.iter().map(|label| T::from_f64(label.map_or(-1.0, f64::from))).collect();
        file.check(&key, &found);
    }
    file
}

/// Front to back along each ray, `alpha = min(alpha_max, sigma(lambda logit) falloff)`.
fn weights<T: Real>(file: &Reference, lambda: f64) -> Vec<T> {
    let (splats, most) = (file.size("splats"), T::from_f64(file.number("alpha_max")));
    let logits: Vec<T> = file.data("in.opacity_logits");
    let mut opacities: Vec<T> = logits.iter().map(|x| T::ONE / (T::ONE + (-*x).exp())).collect();
    guide(&mut opacities, lambda).unwrap_or_else(|e| panic!("{e}"));
    let (ids, falloffs): (Vec<f64>, Vec<T>) = (file.data("in.ids"), file.data("in.falloff"));
    let per_ray = file.size("per_ray");
    let mut weights = vec![T::ZERO; file.size("rays") * splats];
    for (ray, row) in weights.chunks_exact_mut(splats).enumerate() {
        let mut light = T::ONE;
        for hit in (ray * per_ray..(ray + 1) * per_ray).filter(|hit| ids[*hit] >= 0.0) {
            let alpha = (opacities[ids[hit] as usize] * falloffs[hit]).min(most);
            row[ids[hit] as usize] += alpha * light;
            light *= T::ONE - alpha;
        }
    }
    weights
}

fn with_noise<T: Real>(file: &Reference, a: &[T], splats: usize, channels: usize) -> Vec<T> {
    let clean = drawn(a, &file.data::<T>("in.planted"), splats, channels);
    clean.iter().zip(file.data::<T>("in.noise")).map(|(x, noise)| *x + noise).collect()
}

/// `A x`
fn drawn<T: Real>(a: &[T], x: &[T], splats: usize, channels: usize) -> Vec<T> {
    let mut y = vec![T::ZERO; a.len() / splats * channels];
    let dense = Dense::new(a.to_vec(), splats, 1);
    dense.and_then(|mut dense| dense.forward(0, x, channels, &mut y)).unwrap_or_else(|e| panic!("{e}"));
    y
}

/// `A^T y`
fn gathered<T: Real>(a: &[T], y: &[T], splats: usize, channels: usize) -> Vec<T> {
    let mut x = vec![T::ZERO; splats * channels];
    let dense = Dense::new(a.to_vec(), splats, 1);
    dense.and_then(|mut dense| dense.adjoint(0, y, channels, &mut x)).unwrap_or_else(|e| panic!("{e}"));
    x
}

/// `sum_ij A_ij f(|x_j - B_i|)`
fn weighted<T: Real>(a: &[T], x: &[T], b: &[T], splats: usize, channels: usize, f: impl Fn(f64) -> f64) -> f64 {
    let of_ray = |(row, b): (&[T], &[T])| -> f64 {
        let distances = x.chunks_exact(channels).map(|x| squares(&difference(x, b)).sqrt());
        row.iter().zip(distances).map(|(a, d)| a.to_f64() * f(d)).sum()
    };
    a.chunks_exact(splats).zip(b.chunks_exact(channels)).map(of_ray).sum()
}

fn difference<T: Real>(a: &[T], b: &[T]) -> Vec<T> {
    a.iter().zip(b).map(|(a, b)| *a - *b).collect()
}

fn squares<T: Real>(values: &[T]) -> f64 {
    values.iter().map(|x| x.to_f64() * x.to_f64()).sum()
}
