//! Reductions against plain sums in `f64`.

use crate::{assert_close, noise, threads};
use weaver_kernels::Real;
use weaver_kernels::reduce::*;

/// Kahan's compensated sum, so that the twin's own rounding does not count.
fn exact(x: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut lost) = (0.0, 0.0);
    for x in x {
        let y = x - lost;
        let t = sum + y;
        lost = (t - sum) - y;
        sum = t;
    }
    sum
}

fn agrees<T: Real>(n: usize, tolerance: f64) {
    let (x, y) = (noise::<T>(n, 1), noise::<T>(n, 2));
    let plain = exact(x.iter().map(|x| x.to_f64()));
    let product = exact(x.iter().zip(&y).map(|(x, y)| x.to_f64() * y.to_f64()));
    let squares = exact(x.iter().map(|x| x.to_f64().powi(2)));
    let scale = (n as f64 + 1.0).sqrt();
    for (got, exact) in [(sum(&x), plain), (sum_serial(&x), plain), (dot(&x, &y), product), (squared_norm(&x), squares)]
    {
        assert!((got.to_f64() - exact).abs() < tolerance * scale * (1.0 + exact.abs().sqrt()), "{n}: {got} {exact}");
    }
    if n > 0 {
        assert!((mean(&x).to_f64() - plain / n as f64).abs() < tolerance);
    }
}

#[test]
fn sums() {
    for n in (0..70).chain([1000, 16_384, 16_385, 70_001, (1 << 20) + 7]) {
        agrees::<f32>(n, 1e-6);
        agrees::<f64>(n, 1e-14);
    }
}

#[test]
fn a_long_sum_keeps_its_precision() {
    assert!((sum(&vec![0.1_f32; 10_000_000]) / 1_000_000.0 - 1.0).abs() < 1e-5);
}

#[test]
fn rows_and_columns() {
    for (rows, cols) in [(1, 1), (3, 5), (200, 33), (65, 64), (0, 4), (7, 100)] {
        let x = noise::<f64>(rows * cols, 1);
        let mut by_row = vec![f64::NAN; rows];
        let mut by_col = vec![1.0; cols];
        row_sums(rows, cols, &x, (&mut by_row, 0.0));
        column_sums(rows, cols, &x, (&mut by_col, 1.0));
        let expected: Vec<f64> = (0..rows).map(|r| x[r * cols..][..cols].iter().sum()).collect();
        assert_close(&by_row, &expected, 1e-13, "rows");
        let expected: Vec<f64> = (0..cols).map(|c| 1.0 + (0..rows).map(|r| x[r * cols + c]).sum::<f64>()).collect();
        assert_close(&by_col, &expected, 1e-13, "columns");
    }
}

#[test]
fn same_bits_at_any_thread_count() {
    let x = noise::<f32>(300_000, 1);
    threads(|| {
        let mut out = vec![0.0; 1300];
        let (rows, cols) = out.split_at_mut(1000);
        row_sums(1000, 300, &x, (rows, 0.0));
        column_sums(1000, 300, &x, (cols, 0.0));
        out.extend([sum(&x), dot(&x, &x), mean(&x)]);
        out
    });
}
