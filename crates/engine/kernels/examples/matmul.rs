//! A matrix product beside three plain loops: `cargo run --release -p weaver-kernels --example matmul`.
//!
//! Prints the speed of both, the largest difference, and whether one and two threads agree to the bit.

use std::time::Instant;
use weaver_kernels::gemm::{Mat, MatMut, gemm};
use weaver_kernels::{random::Stream, simd};

const N: usize = 768;

fn loops(a: &[f32], b: &[f32], c: &mut [f32]) {
    for (a, c) in a.chunks(N).zip(c.chunks_mut(N)) {
        c.fill(0.0);
        for (a, b) in a.iter().zip(b.chunks(N)) {
            c.iter_mut().zip(b).for_each(|(c, b)| *c += a * b);
        }
    }
}

/// The best of five runs, in GFLOP/s.
fn speed(mut run: impl FnMut()) -> f64 {
    let seconds = || {
        let started = Instant::now();
        run();
        started.elapsed().as_secs_f64()
    };
    2.0 * (N as f64).powi(3) / std::iter::repeat_with(seconds).take(5).fold(f64::INFINITY, f64::min) / 1e9
}

fn main() {
    let noise = |seed| -> Vec<f32> { (0..(N * N) as u64).map(|i| Stream::new(seed, 0, "matmul").normal(i)).collect() };
    let (a, b) = (noise(1), noise(2));
    let (mut plain, mut one, mut all) = (vec![0.0; N * N], vec![0.0; N * N], vec![0.0; N * N]);
    let product = |c: &mut [f32]| gemm(1.0, Mat::new(&a, N, N), Mat::new(&b, N, N), 0.0, MatMut::new(c, N, N));
    let single = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread can be had");
    println!("[{N} x {N}] x [{N} x {N}], instructions: {:?}", simd::level());
    println!("three loops       {:6.1} GFLOP/s", speed(|| loops(&a, &b, &mut plain)));
    println!("gemm, one thread  {:6.1} GFLOP/s", speed(|| single.install(|| product(&mut one))));
    println!("gemm, all threads {:6.1} GFLOP/s", speed(|| product(&mut all)));
    let difference = plain.iter().zip(&all).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
    println!("largest difference {difference:.1e}; any number of threads, the same bits: {}", one == all);
}
