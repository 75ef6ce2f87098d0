//! `gemm` against the triple loop.

use crate::{matrix, noise, threads};
use weaver_kernels::Real;
use weaver_kernels::gemm::{Mat, MatMut, gemm, gemm_batched, gemm_serial};
use weaver_kernels::random::Stream;

fn naive<T: Real>(alpha: T, a: Mat<T>, b: Mat<T>, beta: T, c: &mut [T]) {
    let (m, n, k) = (a.rows, b.cols, a.cols);
    for i in 0..m {
        for j in 0..n {
            // In f64, so that the twin's own rounding does not count.
            let mut sum = 0.0;
            for p in 0..k {
                let x = a.data[i * a.row_stride + p * a.col_stride];
                let y = b.data[p * b.row_stride + j * b.col_stride];
                sum += x.to_f64() * y.to_f64();
            }
            let old = if beta == T::ZERO { T::ZERO } else { beta * c[i * n + j] };
            c[i * n + j] = alpha * T::from_f64(sum) + old;
        }
    }
}

fn agrees<T: Real>(ta: bool, tb: bool, [m, n, k]: [usize; 3], alpha: f64, beta: f64) {
    let (a, b, old) = (noise::<T>(m * k, 1), noise::<T>(k * n, 2), noise::<T>(m * n, 3));
    // C must not be read when beta is 0.
    let start = if beta == 0.0 { vec![T::from_f64(f64::NAN); m * n] } else { old };
    let (alpha, beta) = (T::from_f64(alpha), T::from_f64(beta));
    let (mut c, mut expected) = (start.clone(), start);
    let (a, b) = (matrix(&a, m, k, ta), matrix(&b, k, n, tb));
    gemm(alpha, a, b, beta, MatMut::new(&mut c, m, n));
    naive(alpha, a, b, beta, &mut expected);
    let tolerance = T::from_f64(8.0) * T::EPSILON * T::from_usize(k + 1).sqrt();
    for (i, (c, e)) in c.iter().zip(&expected).enumerate() {
        assert!((*c - *e).abs() <= tolerance * (T::ONE + e.abs()), "{m}x{n}x{k} {ta} {tb} at {i}: {c} {e}");
    }
}

fn all_small<T: Real>() {
    for m in 0..=20 {
        for n in 0..=20 {
            for k in 0..=20 {
                let (ta, tb) = ((m + k) % 2 == 0, (n + k / 2) % 2 == 0);
                agrees::<T>(ta, tb, [m, n, k], 1.0, 0.0);
                agrees::<T>(!ta, tb, [m, n, k], 0.5, 1.0);
                agrees::<T>(ta, !tb, [m, n, k], -1.5, 0.25);
                agrees::<T>(!ta, !tb, [m, n, k], 1.0, 1.0);
            }
        }
    }
}

#[test]
fn small_f32() {
    all_small::<f32>();
}

#[test]
fn small_f64() {
    all_small::<f64>();
}

/// Every size from 1 to 70 in all three dimensions together: windows of three large matrices of small integers, whose
/// products are exact. The expected product grows with k. One in nine of them by default: each size of a dimension with
/// some of the others.
fn every_size<T: Real + PartialEq>() {
    const MOST: usize = 70;
    let integers = |seed| -> Vec<T> {
        let stream = Stream::new(seed, 0, "gemm.sizes");
        (0..(MOST * MOST) as u64).map(|i| T::from_f64(stream.below(i, 9) as f64 - 4.0)).collect()
    };
    let (a, b) = (integers(1), integers(2));
    let transposed = |x: &[T]| -> Vec<T> { (0..MOST * MOST).map(|i| x[i % MOST * MOST + i / MOST]).collect() };
    let (at, bt) = (transposed(&a), transposed(&b));
    let (mut expected, mut c) = (vec![T::ZERO; MOST * MOST], vec![T::ZERO; MOST * MOST]);
    let all = crate::stressed();
    for k in 1..=MOST {
        for (i, e) in expected.iter_mut().enumerate() {
            *e += a[i / MOST * MOST + k - 1] * b[(k - 1) * MOST + i % MOST];
        }
        for m in 1..=MOST {
            for n in (1..=MOST).filter(|n| all || (m + 2 * k + 4 * n) % 9 == 0) {
                let window = |x, xt, rows, cols, transposed| match transposed {
                    false => Mat::new(x, rows, cols).with_row_stride(MOST),
                    true => Mat::new(xt, cols, rows).with_row_stride(MOST).transposed(),
                };
                let (a, b) = (window(&a, &at, m, k, (m + k) % 2 == 1), window(&b, &bt, k, n, (n + k) % 2 == 1));
                let c = &mut c[..m * n];
                gemm_serial(T::ONE, a, b, T::ZERO, MatMut::new(c, m, n));
                let same = c.chunks_exact(n).zip(expected.chunks_exact(MOST)).all(|(c, e)| c == &e[..n]);
                assert!(same, "{m}x{n}x{k}");
            }
        }
    }
}

#[test]
fn every_size_to_70_f32() {
    every_size::<f32>();
}

#[test]
fn every_size_to_70_f64() {
    every_size::<f64>();
}

#[test]
fn larger() {
    for size in [
        [51, 288, 96],
        [220, 384, 96],
        [51, 51, 32],
        [517, 23, 32],
        [100, 16, 16],
        [33, 130, 700],
        [12, 32, 256],
        [13, 33, 257],
        [1, 300, 40],
        [300, 1, 40],
    ] {
        for (ta, tb) in [(false, false), (false, true), (true, false), (true, true)] {
            agrees::<f32>(ta, tb, size, 1.0, 0.0);
            agrees::<f64>(ta, tb, size, 0.7, 1.0);
        }
    }
}

/// Sizes at which everything is cut that can be: several sweeps over packed rows of A, several blocks of the depth,
/// rows of A a multiple of 4 KiB apart. Of small integers, whose products are exact.
#[test]
fn every_cut() {
    for [m, n, k] in [[600, 100, 520], [300, 300, 800], [13, 100, 1024], [7, 1100, 20]] {
        let integers = |len, seed| -> Vec<f32> {
            let stream = Stream::new(seed, 0, "gemm.cuts");
            (0..len as u64).map(|i| stream.below(i, 9) as f32 - 4.0).collect()
        };
        let (a, b) = (integers(m * k, 1), integers(k * n, 2));
        for (ta, tb) in [(false, false), (false, true), (true, false), (true, true)] {
            let mut expected = vec![0.0; m * n];
            let (a, b) = (matrix(&a, m, k, ta), matrix(&b, k, n, tb));
            naive(1.0, a, b, 0.0, &mut expected);
            let c = threads(|| {
                let mut c = vec![f32::NAN; m * n];
                gemm(1.0, a, b, 0.0, MatMut::new(&mut c, m, n));
                c
            });
            assert!(c == expected, "{m}x{n}x{k} {ta} {tb}");
        }
    }
}

#[test]
fn batched_and_strided() {
    let (batch, m, n, k) = (5, 7, 9, 11);
    let (a, b) = (noise::<f64>(batch * m * k + 3, 1), noise::<f64>(k * n, 2));
    let mut c = vec![0.0; batch * (m * n + 2)];
    let shared = Mat::new(&b, n, k).transposed();
    let output = MatMut::new(&mut c, m, n).batch(m * n + 2);
    gemm_batched(batch, 1.0, Mat::new(&a, m, k).batch(m * k), shared.batch(0), 0.0, output);
    for e in 0..batch {
        let mut expected = vec![0.0; m * n];
        naive(1.0, Mat::new(&a[e * m * k..], m, k), shared, 0.0, &mut expected);
        for (c, e) in c[e * (m * n + 2)..].iter().zip(&expected) {
            assert!((c - e).abs() < 1e-13);
        }
        assert_eq!(c[e * (m * n + 2) + m * n..][..2], [0.0; 2]);
    }
    // A window of a wider matrix, every other column of A, C with gaps.
    let (wide, b) = (noise::<f64>(m * 3 * k, 4), noise::<f64>(k * n, 5));
    let (mut c, mut serial) = (vec![1.0; m * (n + 4)], vec![1.0; m * (n + 4)]);
    let window = Mat { data: &wide, rows: m, cols: k, row_stride: 3 * k, col_stride: 2 };
    gemm(2.0, window, Mat::new(&b, k, n), 1.0, MatMut::new(&mut c, m, n).with_row_stride(n + 4));
    gemm_serial(2.0, window, Mat::new(&b, k, n), 1.0, MatMut::new(&mut serial, m, n).with_row_stride(n + 4));
    assert_eq!(c, serial);
    for i in 0..m {
        for j in 0..n + 4 {
            let sum: f64 = if j < n { (0..k).map(|p| wide[i * 3 * k + 2 * p] * b[p * n + j]).sum() } else { 0.0 };
            assert!((c[i * (n + 4) + j] - 1.0 - 2.0 * sum).abs() < 1e-13);
        }
    }
}

/// Matrices that share B and follow on one another are multiplied as one, with the bits of separate products.
#[test]
fn a_shared_factor_gives_bits_of_separate_products() {
    let (batch, m, n, k) = (7, 13, 40, 30);
    let (a, b) = (noise::<f32>(batch * m * k, 1), noise::<f32>(k * n, 2));
    let shared = Mat::new(&b, k, n);
    let mut separate = vec![f32::NAN; batch * m * n];
    for (a, c) in a.chunks_exact(m * k).zip(separate.chunks_exact_mut(m * n)) {
        gemm_serial(1.0, Mat::new(a, m, k), shared, 0.0, MatMut::new(c, m, n));
    }
    let together = threads(|| {
        let mut c = vec![f32::NAN; batch * m * n];
        let output = MatMut::new(&mut c, m, n).batch(m * n);
        gemm_batched(batch, 1.0, Mat::new(&a, m, k).batch(m * k), shared.batch(0), 0.0, output);
        c
    });
    assert_eq!(together, separate);
}

#[test]
fn same_bits_at_any_thread_count() {
    for [m, n, k] in [[301, 275, 300], [30, 1500, 900], [900, 40, 70]] {
        let (a, b) = (noise::<f32>(m * k, 1), noise::<f32>(k * n, 2));
        threads(|| {
            let mut c = vec![0.0; m * n];
            gemm(1.0, Mat::new(&a, m, k), Mat::new(&b, n, k).transposed(), 0.0, MatMut::new(&mut c, m, n));
            c
        });
    }
}

#[test]
#[should_panic(expected = "gemm: C is too short")]
fn short_output_panics() {
    let square = Mat::new(&[0.0_f32; 16], 4, 4);
    gemm(1.0, square, square, 0.0, MatMut::new(&mut [0.0; 15], 4, 4));
}

#[test]
#[should_panic(expected = "rows and columns of B")]
fn shapes_that_do_not_fit_panic() {
    let x = [0.0_f32; 6];
    gemm(1.0, Mat::new(&x, 2, 3), Mat::new(&x, 2, 3), 0.0, MatMut::new(&mut [0.0; 6], 2, 3));
}

#[test]
#[should_panic(expected = "rows of A and of C")]
fn an_output_of_other_rows_panics() {
    let x = [0.0_f32; 4];
    gemm(1.0, Mat::new(&x, 2, 2), Mat::new(&x, 2, 2), 0.0, MatMut::new(&mut [0.0; 6], 3, 2));
}

#[test]
#[should_panic(expected = "C is too short")]
fn rows_of_c_that_wrap_around_panic() {
    let (a, b, mut c) = ([1.0_f32; 2], [1.0; 2], [0.0; 4]);
    let far = MatMut::new(&mut c[1..], 2, 2).with_row_stride(usize::MAX);
    gemm(1.0, Mat::new(&a, 2, 1), Mat::new(&b, 1, 2), 0.0, far);
}

#[test]
#[should_panic(expected = "A is 1 x 2 x 2")]
fn rows_of_a_that_wrap_around_panic() {
    let (x, b, mut c) = ([1.0_f32; 4], [1.0; 2], [0.0; 2]);
    let far = Mat::new(&x[1..], 2, 2).with_row_stride(usize::MAX);
    gemm(1.0, far, Mat::new(&b, 2, 1), 0.0, MatMut::new(&mut c, 2, 1));
}
