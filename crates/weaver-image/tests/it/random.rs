//! Random Gaussians, and numbers to compare.

use weaver_image::Gaussians;
use weaver_kernels::Real;
use weaver_kernels::random::Stream;

/// Gaussians around a picture, some of them outside, with scales between the two bounds.
pub fn gaussians<T: Real>(seed: u64, count: usize, size: [usize; 2], scales: [f64; 2]) -> Gaussians<T> {
    let stream = Stream::new(seed, 0, "test.gaussians");
    let uniform = |i: usize, low: f64, high: f64| low + (high - low) * stream.uniform::<f64>(i as u64);
    let mut out = Gaussians::default();
    for i in 0..count {
        let at = |j: usize, low, high| T::from_f64(uniform(8 * i + j, low, high));
        let center = [at(0, -4.0, size[0] as f64 + 4.0), at(1, -4.0, size[1] as f64 + 4.0)];
        let scale = [at(2, scales[0], scales[1]), at(3, scales[0], scales[1])];
        out.push(center, scale, at(4, -4.0, 4.0), [at(5, -1.0, 1.0), at(6, -1.0, 1.0), at(7, 0.0, 1.0)]);
    }
    out
}

/// Numbers of a normal distribution.
pub fn noise<T: Real>(seed: u64, count: usize) -> Vec<T> {
    let stream = Stream::new(seed, 0, "test.noise");
    (0..count).map(|i| stream.normal(i as u64)).collect()
}

/// The largest difference.
pub fn apart<T: Real>(a: &[T], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a.to_f64() - b).abs()).fold(0.0, f64::max)
}

/// `sum a b`.
pub fn dot<T: Real>(a: &[T], b: &[T]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.to_f64() * b.to_f64()).sum()
}

/// Runs on so many threads.
pub fn on_threads<R: Send>(threads: usize, body: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(body)
}
