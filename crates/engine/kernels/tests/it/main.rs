//! Every kernel against a slow twin, in both precisions, and at more than one thread count.

mod allocation;
mod attention;
mod byte_products;
mod conv;
mod every_kernel;
mod gemm;
mod lanes;
mod layer_norm;
mod nearest_neighbors;
mod reduce;
mod resample;
mod rope;
mod rows;
mod softmax;
mod special;
mod subdivision;
mod twofold;

use weaver_kernels::Real;
use weaver_kernels::gemm::Mat;
use weaver_kernels::random::Stream;

/// True if sweeps run in full, as `cargo xtask stress` wants them, and not on a sample.
fn stressed() -> bool {
    std::env::var_os("WEAVER_STRESS").is_some()
}

/// `n` numbers, normally distributed.
fn noise<T: Real>(n: usize, seed: u64) -> Vec<T> {
    let stream = Stream::new(seed, 0, "kernels.test");
    (0..n as u64).map(|i| stream.normal(i)).collect()
}

/// Runs `body` with 1, 2, 3 and 4 threads and asserts that the results are equal to the bit.
fn threads<T: Real>(body: impl Fn() -> Vec<T> + Sync) -> Vec<T> {
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
        pool.install(&body)
    };
    let first = run(1);
    assert!(first.iter().any(|x| *x != T::ZERO), "a result of zeros proves nothing");
    for n in [2, 3, 4] {
        assert!(
            run(n).iter().zip(&first).all(|(a, b)| a.to_f64().to_bits() == b.to_f64().to_bits()),
            "{n} threads differ"
        );
    }
    first
}

/// Asserts that `got` is `expected` up to `tolerance` times (1 + |expected|).
fn assert_close<T: Real>(got: &[T], expected: &[f64], tolerance: f64, what: &str) {
    assert_eq!(got.len(), expected.len(), "{what}");
    for (i, (got, expected)) in got.iter().zip(expected).enumerate() {
        let error = (got.to_f64() - expected).abs();
        assert!(error <= tolerance * (1.0 + expected.abs()), "{what} at {i}: {got}, expected {expected}");
    }
}

/// A `rows` x `cols` matrix, stored as its transpose if `transposed`.
fn matrix<T: Real>(data: &[T], rows: usize, cols: usize, transposed: bool) -> Mat<'_, T> {
    if transposed { Mat::new(data, cols, rows).transposed() } else { Mat::new(data, rows, cols) }
}

/// The same numbers in `f64`.
fn widen<T: Real>(x: &[T]) -> Vec<f64> {
    x.iter().map(|x| x.to_f64()).collect()
}

/// Asserts that `gradient` is the gradient of `value` at `x`, by central differences.
fn assert_gradient(gradient: &[f64], x: &[f64], value: impl Fn(&[f64]) -> f64, tolerance: f64) {
    let mut at = x.to_vec();
    for i in (0..x.len()).step_by(x.len() / 40 + 1) {
        let step = 1e-5;
        at[i] = x[i] + step;
        let above = value(&at);
        at[i] = x[i] - step;
        let slope = (above - value(&at)) / (2.0 * step);
        at[i] = x[i];
        assert_close(&gradient[i..=i], &[slope], tolerance, &format!("gradient {i}"));
    }
}
