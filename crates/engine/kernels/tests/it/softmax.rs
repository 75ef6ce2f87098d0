//! Softmax against its formula and finite differences.

use crate::{assert_close, assert_gradient, noise, threads, widen};
use weaver_kernels::Real;
use weaver_kernels::softmax::*;

fn naive([outer, len, inner]: [usize; 3], x: &[f64]) -> Vec<f64> {
    let mut y = vec![0.0; x.len()];
    for o in 0..outer {
        for i in 0..inner {
            let at = |l: usize| (o * len + l) * inner + i;
            let sum: f64 = (0..len).map(|l| x[at(l)].exp()).sum();
            (0..len).for_each(|l| y[at(l)] = x[at(l)].exp() / sum);
        }
    }
    y
}

fn agrees<T: Real>(shape: [usize; 3], tolerance: f64) {
    let [outer, len, inner] = shape;
    let (x, dy) = (noise::<T>(outer * len * inner, 1), noise::<T>(outer * len * inner, 2));
    let mut y = vec![T::from_f64(f64::NAN); x.len()];
    softmax_forward(len, inner, &x, &mut y);
    assert_close(&y, &naive(shape, &widen(&x)), tolerance, &format!("{shape:?}"));
    let mut dx = vec![T::from_f64(f64::NAN); x.len()];
    softmax_backward(len, inner, &y, &dy, (&mut dx, T::ZERO));
    let value = |x: &[f64]| naive(shape, x).iter().zip(&dy).map(|(y, d)| y * d.to_f64()).sum();
    assert_gradient(&widen(&dx), &widen(&x), value, tolerance.max(1e-8));
    let mut twice = dx.clone();
    softmax_backward(len, inner, &y, &dy, (&mut twice, T::ONE));
    for (once, twice) in dx.iter().zip(&twice) {
        assert_close(&[*twice], &[2.0 * once.to_f64()], tolerance, "accumulated");
    }
}

#[test]
fn matches_the_formula() {
    for shape in
        [[3, 5, 1], [1, 1, 1], [2, 33, 1], [2, 4, 5], [1, 3, 50], [0, 4, 1], [4, 9, 16], [2, 100, 1], [7, 64, 1]]
    {
        agrees::<f64>(shape, 1e-14);
        agrees::<f32>(shape, 1e-6);
    }
}

#[test]
fn large_inputs_do_not_overflow() {
    let mut y = [0.0_f32; 3];
    softmax_forward(3, 1, &[1000.0, 1000.0, -1000.0], &mut y);
    assert_eq!(y, [0.5, 0.5, 0.0]);
}

#[test]
fn same_bits_at_any_thread_count() {
    let x = noise::<f32>(60_000, 1);
    threads(|| {
        let (mut a, mut b, mut da) = (x.clone(), x.clone(), x.clone());
        softmax_forward(30, 1, &x, &mut a);
        softmax_forward(4, 50, &x, &mut b);
        softmax_backward(30, 1, &a, &x, (&mut da, 0.0));
        [a, b, da].concat()
    });
}
