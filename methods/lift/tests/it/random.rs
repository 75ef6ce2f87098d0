//! Random weights, scenes and features, and a slow way to the least squares.

use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_kernels::Real;
use weaver_kernels::random::Stream;
use weaver_lift::{LiftOptions, Lifted, Maps, Operator, lift};
use weaver_scene::{Color, GaussianSlices};

/// Gaussians without colors.
#[derive(Clone, Debug)]
pub struct Splats<T> {
    pub means: Vec<T>,
    pub quats: Vec<T>,
    pub scales: Vec<T>,
    pub opacities: Vec<T>,
}

impl<T: Real> Splats<T> {
    /// Gaussians before the cameras of [`cameras`], some of them out of sight.
    pub fn random(seed: u64, count: usize) -> Self {
        let stream = Stream::new(seed, 0, "lift.test");
        let normal = |purpose: u64, i: usize| stream.fork(purpose).normal::<f64>(i as u64);
        let numbers = |count: usize, f: &dyn Fn(usize) -> f64| (0..count).map(|i| T::from_f64(f(i))).collect();
        Self {
            means: numbers(3 * count, &|i| if i % 3 == 2 { 3.0 + 0.7 * normal(0, i) } else { 0.8 * normal(0, i) }),
            quats: numbers(4 * count, &|i| normal(1, i)),
            scales: numbers(3 * count, &|i| (0.4 * normal(2, i) - 2.0).exp()),
            opacities: numbers(count, &|i| 1.0 / (1.0 + (-1.0 - normal(3, i)).exp())),
        }
    }

    pub fn as_slices(&self) -> GaussianSlices<'_, T> {
        let Self { means, quats, scales, opacities } = self;
        GaussianSlices { means, quats, scales, opacities, color: Color::None, features: None, groups: None }
    }

    /// The same Gaussians in another order.
    pub fn permuted(&self, order: &[usize]) -> Self {
        Self {
            means: permuted(&self.means, 3, order),
            quats: permuted(&self.quats, 4, order),
            scales: permuted(&self.scales, 3, order),
            opacities: permuted(&self.opacities, 1, order),
        }
    }
}

/// `values` with its rows in another order.
pub fn permuted<T: Copy>(values: &[T], channels: usize, order: &[usize]) -> Vec<T> {
    order.iter().flat_map(|&j| values[j * channels..(j + 1) * channels].iter().copied()).collect()
}

/// Cameras of different sizes that look along +z.
pub fn cameras(count: usize) -> Vec<Camera> {
    (0..count)
        .map(|i| {
            let turn = 0.15 * i as f64;
            let pose = Pose::new(DMat3::from_rotation_y(turn), DVec3::new(0.1 * i as f64, -0.05 * i as f64, 0.2));
            let (width, height) = (24 + 3 * i, 18 + i);
            let intrinsics = Intrinsics { fx: 22.0, fy: 21.0, cx: 0.5 * width as f64, cy: 0.5 * height as f64 };
            Camera { pose, intrinsics, width, height }
        })
        .collect()
}

/// Normal numbers.
pub fn noise<T: Real>(seed: u64, count: usize) -> Vec<T> {
    let stream = Stream::new(seed, 0, "lift.noise");
    (0..count).map(|i| stream.normal(i as u64)).collect()
}

/// Weights as from compositing: rows sum to at most 1, and to exactly 1 if `full`.
pub fn weights(seed: u64, rays: usize, splats: usize, full: bool) -> Vec<f64> {
    let stream = Stream::new(seed, 0, "lift.weights");
    let mut weights = vec![0.0; rays * splats];
    for (i, row) in weights.chunks_exact_mut(splats).enumerate() {
        let stream = stream.fork(i as u64);
        for (j, weight) in row.iter_mut().enumerate() {
            let [here, size] = [2 * j as u64, 2 * j as u64 + 1].map(|at| stream.uniform::<f64>(at));
            *weight = if here < 0.4 || j == i % splats { size } else { 0.0 };
        }
        let sum: f64 = row.iter().sum();
        let of = if full { 1.0 } else { 0.3 + 0.7 * stream.uniform::<f64>(1 << 20) };
        row.iter_mut().for_each(|x| *x *= of / sum);
    }
    weights
}

/// Lifts features in memory, without masks.
pub fn lifted<T: Real>(
    operator: &mut impl Operator<T>,
    views: &[Vec<T>],
    channels: usize,
    options: LiftOptions,
) -> Lifted<T> {
    let mut maps = Maps { views: views.to_vec(), channels };
    lift(operator, &mut maps, &LiftOptions { least_alpha: None, ..options }, &mut || ()).unwrap()
}

/// The whole matrix of an operator, `[R, P]`.
pub fn matrix(operator: &mut impl Operator<f64>) -> Vec<f64> {
    let splats = operator.splats();
    let mut whole = Vec::new();
    for view in 0..operator.views() {
        let rays = operator.rays(view);
        let mut part = vec![0.0; rays * splats];
        let mut identity = vec![0.0; splats * splats];
        (0..splats).for_each(|j| identity[j * splats + j] = 1.0);
        operator.forward(view, &identity, splats, &mut part).unwrap();
        whole.extend(part);
    }
    whole
}

/// `a b` of `[n, k]` and `[k, m]`.
pub fn product(a: &[f64], b: &[f64], k: usize, m: usize) -> Vec<f64> {
    let row = |row: &[f64], c: usize| (0..k).map(|i| row[i] * b[i * m + c]).sum::<f64>();
    a.chunks_exact(k).flat_map(|r| (0..m).map(move |c| row(r, c))).collect()
}

pub fn transposed(a: &[f64], columns: usize) -> Vec<f64> {
    (0..columns).flat_map(|j| a.iter().skip(j).step_by(columns).copied()).collect()
}

/// The solution of `g x = b` for symmetric positive `g` `[n, n]`, by elimination.
pub fn solved(g: &[f64], b: &[f64], n: usize, m: usize) -> Vec<f64> {
    let (mut g, mut x) = (g.to_vec(), b.to_vec());
    for p in 0..n {
        for i in (0..n).filter(|i| *i != p) {
            let by = g[i * n + p] / g[p * n + p];
            (0..n).for_each(|k| g[i * n + k] -= by * g[p * n + k]);
            (0..m).for_each(|c| x[i * m + c] -= by * x[p * m + c]);
        }
    }
    x.chunks_exact_mut(m).enumerate().for_each(|(i, row)| row.iter_mut().for_each(|v| *v /= g[i * n + i]));
    x
}

pub fn squares(values: &[f64]) -> f64 {
    values.iter().map(|x| x * x).sum()
}

pub fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// Largest difference, relative to the largest number.
pub fn error(a: &[f64], b: &[f64]) -> f64 {
    let largest = |x: &[f64]| x.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    largest(&difference(a, b)) / largest(b).max(1.0)
}
