//! Layer normalization against its formula and finite differences.

use crate::{assert_close, assert_gradient, noise, threads, widen};
use weaver_kernels::Real;
use weaver_kernels::layer_norm::*;

fn naive(cols: usize, eps: f64, x: &[f64], w: &[f64], b: &[f64]) -> Vec<f64> {
    let row = |x: &[f64]| {
        let mean = x.iter().sum::<f64>() / cols as f64;
        let variance = x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / cols as f64;
        (0..cols).map(|i| (x[i] - mean) / (variance + eps).sqrt() * w[i] + b[i]).collect::<Vec<_>>()
    };
    x.chunks(cols).flat_map(row).collect()
}

fn agrees<T: Real>(rows: usize, cols: usize, tolerance: f64) {
    let eps = T::from_f64(1e-5);
    let (x, w, b) = (noise::<T>(rows * cols, 1), noise::<T>(cols, 2), noise::<T>(cols, 3));
    let (mut y, mut stats) = (vec![T::from_f64(f64::NAN); rows * cols], vec![T::ZERO; rows * 2]);
    layer_norm_forward(cols, eps, &x, Some((&w, &b)), &mut y, &mut stats);
    let exact = |x: &[f64], w: &[f64], b: &[f64]| naive(cols, eps.to_f64(), x, w, b);
    assert_close(&y, &exact(&widen(&x), &widen(&w), &widen(&b)), tolerance, "y");
    let mut plain = y.clone();
    layer_norm_forward(cols, eps, &x, None, &mut plain, &mut stats);
    assert_close(&plain, &exact(&widen(&x), &vec![1.0; cols], &vec![0.0; cols]), tolerance, "without affine");

    let dy = noise::<T>(rows * cols, 4);
    let value =
        |x: &[f64], w: &[f64], b: &[f64]| exact(x, w, b).iter().zip(&dy).map(|(y, d)| y * d.to_f64()).sum::<f64>();
    let (wx, ww, wb) = (widen(&x), widen(&w), widen(&b));
    let mut dx = noise::<T>(rows * cols, 5);
    let old = widen(&dx);
    let mut scratch = vec![T::from_f64(f64::NAN); layer_norm_scratch_len(rows, cols)];
    layer_norm_backward(cols, &x, Some(&w), &stats, &dy, [Some((&mut dx, T::ONE)), None, None], &mut scratch);
    let added: Vec<f64> = dx.iter().zip(&old).map(|(a, b)| a.to_f64() - b).collect();
    assert_gradient(&added, &wx, |x| value(x, &ww, &wb), tolerance.max(1e-7));
    layer_norm_backward(cols, &x, None, &stats, &dy, [Some((&mut dx, T::ZERO)), None, None], &mut scratch);
    assert_gradient(&widen(&dx), &wx, |x| value(x, &vec![1.0; cols], &wb), tolerance.max(1e-7));
    let (mut dw, mut db) = (vec![T::from_f64(f64::NAN); cols], vec![T::from_f64(f64::NAN); cols]);
    let targets = [None, Some((&mut dw[..], T::ZERO)), Some((&mut db[..], T::ZERO))];
    layer_norm_backward(cols, &x, None, &stats, &dy, targets, &mut scratch);
    assert_gradient(&widen(&dw), &ww, |w| value(&wx, w, &wb), tolerance.max(1e-7));
    assert_gradient(&widen(&db), &wb, |b| value(&wx, &ww, b), tolerance.max(1e-7));
}

#[test]
fn matches_the_formula() {
    for (rows, cols) in [(1, 4), (3, 16), (5, 33), (70, 7), (2, 96)] {
        agrees::<f64>(rows, cols, 1e-10);
        agrees::<f32>(rows, cols, 1e-4);
    }
}

#[test]
fn same_bits_at_any_thread_count() {
    let (cols, x) = (96, noise::<f32>(500 * 96, 1));
    threads(|| {
        let (mut y, mut stats, mut dx, mut dw) = (x.clone(), vec![0.0; 1000], x.clone(), vec![0.0; cols]);
        layer_norm_forward(cols, 1e-5, &x, None, &mut y, &mut stats);
        let mut scratch = vec![0.0; layer_norm_scratch_len(500, cols)];
        let targets = [Some((&mut dx[..], 0.0)), Some((&mut dw[..], 0.0)), None];
        layer_norm_backward(cols, &x, None, &stats, &x, targets, &mut scratch);
        [y, stats, dx, dw].concat()
    });
}

#[test]
#[should_panic(expected = "layer_norm: lengths")]
fn a_row_and_a_half_is_refused() {
    layer_norm_forward(2, 0.0, &[1.0; 3], None, &mut [0.0; 3], &mut [0.0; 3]);
}

#[test]
#[should_panic(expected = "layer_norm: lengths")]
fn a_gradient_of_a_row_and_a_half_is_refused() {
    let mut dx = [0.0; 3];
    let targets = [Some((&mut dx[..], 0.0)), None, None];
    layer_norm_backward(2, &[1.0; 3], None, &[1.0; 3], &[1.0; 3], targets, &mut [0.0; 8]);
}
