//! Moving rows, permuting axes, the optimizer: against plain loops.

use crate::{assert_close, noise, threads, widen};
use proptest::prelude::*;
use weaver_kernels::Real;
use weaver_kernels::optim::{AdamW, lerp};
use weaver_kernels::permute::{inverse, permute};
use weaver_kernels::random::Stream;
use weaver_kernels::rows::*;

fn indices(n: usize, rows: usize) -> Vec<u32> {
    (0..n as u64).map(|i| Stream::new(3, 0, "rows").below(i, rows) as u32).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 10))]

    #[test]
    fn gather_and_scatter(rows in 1..40usize, n in 0..90usize, cols in 0..9usize) {
        let index = indices(n, rows);
        let x = noise::<f64>(rows * cols, 1);
        let mut y = vec![f64::NAN; n * cols];
        gather_rows(cols, &x, &index, (&mut y, 0.0));
        for i in 0..n * cols {
            prop_assert_eq!(y[i], x[index[i / cols] as usize * cols + i % cols]);
        }
        let mut sums = vec![1.0; rows * cols];
        scatter_add_rows(cols, &y, &index, (&mut sums, 1.0));
        let mut expected = vec![1.0; rows * cols];
        for i in 0..n * cols {
            expected[index[i / cols] as usize * cols + i % cols] += y[i];
        }
        prop_assert_eq!(sums, expected);
        let mut fresh = vec![f64::NAN; rows * cols];
        scatter_add_rows(cols, &y, &index, (&mut fresh, 0.0));
        prop_assert!(fresh.iter().all(|x| x.is_finite()));
    }

    #[test]
    fn permutations(dims in prop::collection::vec(prop_oneof![1 => Just(1), 3 => 2..4usize, 1 => 15..40usize], 5), seed: u64) {
        let shape: [usize; 5] = dims.try_into().expect("five of them");
        let order = Stream::new(seed, 0, "axes").permutation(5);
        let axes: [usize; 5] = order.try_into().expect("five of them");
        let x = noise::<f64>(shape.iter().product(), 1);
        let mut y = vec![f64::NAN; x.len()];
        permute(shape, axes, &x, (&mut y, 0.0));
        let moved = axes.map(|axis| shape[axis]);
        for (i, y) in y.iter().enumerate() {
            let (mut rest, mut at) = (i, [0; 5]);
            for k in (0..5).rev() {
                (at[axes[k]], rest) = (rest % moved[k], rest / moved[k]);
            }
            prop_assert_eq!(*y, x[at.iter().zip(shape).fold(0, |offset, (i, d)| offset * d + i)]);
        }
        let mut back = x.clone();
        permute(moved, inverse(axes), &y, (&mut back, 1.0));
        prop_assert!(back.iter().zip(&x).all(|(b, x)| *b == 2.0 * x));
        permute(moved, inverse(axes), &y, (&mut back, 0.0));
        prop_assert_eq!(back, x);
    }

    #[test]
    fn blocks(rows in 0..30usize, cols in 0..9usize, gap in 0..4usize, shift in 0..4usize) {
        let x = noise::<f64>(rows * cols, 1);
        let stride = cols + gap + shift;
        let mut y = vec![5.0; rows * stride + cols + shift];
        copy_blocks(rows, cols, &x, cols, (&mut y[shift..], 1.0), stride.max(1));
        let mut back = vec![f64::NAN; rows * cols];
        copy_blocks(rows, cols, &y[shift..], stride, (&mut back, 0.0), cols.max(1));
        prop_assert!(back.iter().zip(&x).all(|(y, x)| *y == 5.0 + x));
        prop_assert_eq!(y.iter().filter(|y| **y == 5.0).count(), y.len() - rows * cols);
    }
}

#[test]
fn a_long_transpose_in_several_tasks() {
    for (rows, cols) in [(3, 70_001), (70_001, 3), (517, 301)] {
        let x = noise::<f32>(rows * cols, 1);
        let (mut y, mut back) = (vec![f32::NAN; x.len()], vec![f32::NAN; x.len()]);
        permute([rows, cols], [1, 0], &x, (&mut y, 0.0));
        assert!(y.iter().enumerate().all(|(i, y)| *y == x[i % rows * cols + i / rows]));
        permute([cols, rows], [1, 0], &y, (&mut back, 0.0));
        assert_eq!(back, x);
    }
}

#[test]
fn a_scalar_and_nothing_permuted() {
    let mut y = [f32::NAN];
    permute([], [], &[3.0], (&mut y, 0.0));
    assert_eq!(y, [3.0]);
    permute([2, 0], [1, 0], &[], (&mut y[..0], 0.0));
}

#[test]
#[should_panic(expected = "is not a permutation")]
fn an_axis_that_comes_twice_is_refused() {
    permute([1, 1], [1, 1], &[3.0], (&mut [0.0], 0.0));
}

#[test]
#[should_panic(expected = "not below 2")]
fn too_large_an_index_panics() {
    scatter_add_rows(1, &[1.0_f32], &[2], (&mut [0.0; 2], 0.0));
}

fn adamw<T: Real>(tolerance: f64) {
    let n = 40_000;
    let (mut p, mut m, mut v) = (noise::<T>(n, 1), vec![T::ZERO; n], vec![T::ZERO; n]);
    let [mut q, mut a, mut b] = [widen(&p), vec![0.0; n], vec![0.0; n]];
    let settings = [0.01, 0.9, 0.99, 1e-8, 0.1, 0.5].map(T::from_f64);
    let [rate, beta1, beta2, eps, weight_decay, gradient_scale] = settings;
    let [r, b1, b2, e, decay, scale] = settings.map(T::to_f64);
    for step in 1..=3 {
        let g = noise::<T>(n, 10 + step);
        AdamW { rate, beta1, beta2, eps, weight_decay, gradient_scale }.step(step, &mut p, &g, &mut m, &mut v);
        for i in 0..n {
            let g = g[i].to_f64() * scale;
            a[i] = b1 * a[i] + (1.0 - b1) * g;
            b[i] = b2 * b[i] + (1.0 - b2) * g * g;
            let (mean, square) = (a[i] / (1.0 - b1.powi(step as i32)), b[i] / (1.0 - b2.powi(step as i32)));
            q[i] -= r * (mean / (square.sqrt() + e) + decay * q[i]);
        }
    }
    assert_close(&p, &q, tolerance, "AdamW");
    let mut average = vec![T::ONE; n];
    lerp(&mut average, &p, T::from_f64(0.75));
    assert_close(&average, &q.iter().map(|q| 0.75 + 0.25 * q).collect::<Vec<_>>(), tolerance, "lerp");
}

#[test]
fn adamw_matches_the_paper() {
    adamw::<f64>(1e-13);
    adamw::<f32>(1e-6);
}

#[test]
fn same_bits_at_any_thread_count() {
    let (x, index) = (noise::<f32>(20_000 * 8, 1), indices(20_000, 3000));
    threads(|| {
        let (mut y, mut g) = (vec![0.0; 3000 * 8], vec![0.0; x.len()]);
        scatter_add_rows(8, &x, &index, (&mut y, 0.0));
        gather_rows(8, &y, &index, (&mut g, 0.0));
        let mut moved = x.clone();
        permute([10, 20, 100, 8], [2, 0, 3, 1], &x, (&mut moved, 0.0));
        [y, g, moved].concat()
    });
}
