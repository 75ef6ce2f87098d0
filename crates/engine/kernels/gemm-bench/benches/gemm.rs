//! The matrix product of weaver-kernels beside the `gemm` and `faer` crates, C = A B in `f32`, row-major, on one thread
//! and on two:
//!
//!     cargo bench --manifest-path crates/engine/kernels/gemm-bench/Cargo.toml
//!
//! Throughput is in floating-point operations. Before the timings, the bench checks each result against weaver-kernels,
//! and prints whether a library gives the same bits on one, two and three threads and how often a repeated call
//! allocates.

use criterion::{BenchmarkId, Criterion, Throughput};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut as FaerMut, MatRef as FaerRef, Par};
use std::hint::black_box;
use std::time::Duration;
use weaver_kernels::gemm::{Mat, MatMut};
use weaver_kernels::random::Stream;

/// Rows of A, columns of A, columns of B.
const SIZES: [[usize; 3]; 6] =
    [[64, 64, 64], [512, 512, 512], [1024, 1024, 1024], [2048, 2048, 2048], [1374, 1024, 4096], [2048, 384, 1536]];

/// C = A B on the threads of the current pool.
type Product = fn([usize; 3], &[f32], &[f32], &mut [f32]);

const LIBRARIES: [(&str, Product); 3] = [("weaver-kernels", weaver), ("gemm", gemm), ("faer", faer)];

fn weaver([m, k, n]: [usize; 3], a: &[f32], b: &[f32], c: &mut [f32]) {
    weaver_kernels::gemm::gemm(1.0, Mat::new(a, m, k), Mat::new(b, k, n), 0.0, MatMut::new(c, m, n));
}

fn gemm([m, k, n]: [usize; 3], a: &[f32], b: &[f32], c: &mut [f32]) {
    let parallelism = match rayon::current_num_threads() {
        1 => gemm::Parallelism::None,
        threads => gemm::Parallelism::Rayon(threads),
    };
    let [k_stride, n_stride] = [k, n].map(|stride| stride as isize);
    assert!(a.len() == m * k && b.len() == k * n && c.len() == m * n);
    let (c, a, b) = (c.as_mut_ptr(), a.as_ptr(), b.as_ptr());
    // The first factor applies to the old C, the second to the product.
    let (alpha, beta) = (0.0, 1.0);
    // SAFETY: the three matrices are contiguous and row-major, and their slices as long as they are.
    unsafe {
        gemm::gemm(
            m,
            n,
            k,
            c,
            1,
            n_stride,
            false,
            a,
            1,
            k_stride,
            b,
            1,
            n_stride,
            alpha,
            beta,
            false,
            false,
            false,
            parallelism,
        );
    }
}

fn faer([m, k, n]: [usize; 3], a: &[f32], b: &[f32], c: &mut [f32]) {
    let par = match rayon::current_num_threads() {
        1 => Par::Seq,
        threads => Par::rayon(threads),
    };
    let (a, b) = (FaerRef::from_row_major_slice(a, m, k), FaerRef::from_row_major_slice(b, k, n));
    matmul(FaerMut::from_row_major_slice_mut(c, m, n), Accum::Replace, a, b, 1.0, par);
}

fn noise(n: usize, seed: u64) -> Vec<f32> {
    let stream = Stream::new(seed, 0, "gemm.bench");
    (0..n as u64).map(|i| stream.normal(i)).collect()
}

fn on_threads<R: Send>(threads: usize, job: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads").install(job)
}

/// Checks the results, and prints further differences between the libraries.
fn compare() {
    for size in SIZES {
        let [m, k, n] = size;
        let (a, b) = (noise(m * k, 1), noise(k * n, 2));
        let result = |threads, product: Product| {
            on_threads(threads, || {
                let mut c = vec![f32::NAN; m * n];
                product(size, &a, &b, &mut c);
                c
            })
        };
        let expected = result(1, weaver);
        for (name, product) in LIBRARIES {
            let one = result(1, product);
            let error = one.iter().zip(&expected).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
            assert!(error < 1e-5 * k as f32, "{name} differs by {error} at {size:?}");
            let same = [2, 3].iter().all(|threads| result(*threads, product) == one);
            let allocations = on_threads(1, || {
                let mut c = vec![0.0; m * n];
                product(size, &a, &b, &mut c);
                allocation_counter::measure(|| product(size, &a, &b, &mut c)).count_total
            });
            let bits = if same { "the same bits" } else { "other bits" };
            println!("{name} {m}x{k}x{n}: {bits} on more threads, {allocations} allocations in a repeated call");
        }
    }
}

fn main() {
    compare();
    let mut criterion = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2))
        .configure_from_args();
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads");
        let mut group = criterion.benchmark_group(format!("{threads} threads"));
        for size in SIZES {
            let [m, k, n] = size;
            let (a, b) = (noise(m * k, 1), noise(k * n, 2));
            let mut c = vec![0.0; m * n];
            group.throughput(Throughput::Elements(2 * (m * n * k) as u64));
            for (name, product) in LIBRARIES {
                let id = BenchmarkId::new(name, format!("{m}x{k}x{n}"));
                group.bench_function(id, |bench| {
                    pool.install(|| bench.iter(|| product(size, black_box(&a), black_box(&b), &mut c)));
                });
            }
        }
        group.finish();
    }
    criterion.final_summary();
}
