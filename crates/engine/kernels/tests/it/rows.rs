//! Moving rows, permuting axes, the optimizer: against plain loops.

use crate::{assert_close, noise, threads, widen};
use proptest::prelude::*;
use weaver_kernels::Real;
use weaver_kernels::optim::{AdamW, SparseRows, lerp};
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

/// Steps in which each row takes part or not, one row after the other and one number after the other.
fn rows_one_by_one(
    settings: &AdamW<f64>,
    width: usize,
    taking_part: &[Vec<u32>],
    state: [&mut Vec<f64>; 3],
) -> Vec<u64> {
    let [p, m, v] = state;
    let mut row_steps = vec![0; p.len() / width];
    for (step, rows) in (1..).zip(taking_part) {
        let g = noise::<f64>(p.len(), 10 + step);
        for row in rows.iter().map(|r| *r as usize) {
            let skipped = (step - 1 - std::mem::replace(&mut row_steps[row], step)) as f64;
            for i in row * width..(row + 1) * width {
                if skipped > 0.0 {
                    m[i] *= settings.beta1.powf(skipped);
                    v[i] *= settings.beta2.powf(skipped);
                }
                let [p, m, v] = [&mut *p, &mut *m, &mut *v].map(|x| std::slice::from_mut(&mut x[i]));
                settings.step(step, p, &g[i..=i], m, v);
            }
        }
    }
    row_steps
}

/// Ascending rows among `total`; each is taken with this probability, all with 1.
fn some_rows(total: usize, share: f64, seed: u64) -> Vec<u32> {
    let stream = Stream::new(seed, 0, "some rows");
    (0..total as u32).filter(|row| stream.uniform::<f64>(u64::from(*row)) < share).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 10))]

    #[test]
    fn sparse_adamw(total in 1..3000usize, width in 1..20usize, share in 0.0..1.0_f64, seed: u64) {
        let settings = AdamW { rate: 0.01, beta1: 0.9, beta2: 0.99, eps: 1e-8, weight_decay: 0.1, gradient_scale: 0.5 };
        let n = total * width;
        // The last step has every row, so that each shows the steps that it missed.
        let mut steps: Vec<_> = (0..4).map(|step| some_rows(total, share, seed ^ step)).collect();
        steps.push((0..total as u32).collect());
        let begin = || [noise::<f64>(n, 1), noise(n, 2), noise(n, 3).into_iter().map(f64::abs).collect()];
        let [mut p, mut m, mut v] = begin();
        let mut row_steps = vec![0; total];
        for (step, rows) in (1..).zip(&steps) {
            let rows = SparseRows { rows, row_steps: &mut row_steps };
            settings.step_rows(step, &mut p, &noise(n, 10 + step), &mut m, &mut v, rows);
        }
        let [mut twin_p, mut twin_m, mut twin_v] = begin();
        let twin_steps = rows_one_by_one(&settings, width, &steps, [&mut twin_p, &mut twin_m, &mut twin_v]);
        prop_assert_eq!((p, m, v, row_steps), (twin_p, twin_m, twin_v, twin_steps));
    }

    #[test]
    fn every_row_is_the_whole(total in 1..5000usize, width in 1..9usize) {
        let settings = AdamW { rate: 0.01_f32, beta1: 0.9, beta2: 0.99, eps: 1e-8, weight_decay: 0.1, gradient_scale: 0.5 };
        let (n, all) = (total * width, Vec::from_iter(0..total as u32));
        let [mut sparse, mut dense] = [0; 2].map(|_| [noise::<f32>(n, 1), vec![0.0; n], vec![0.0; n]]);
        let mut row_steps = vec![0; total];
        for step in 1..4 {
            let g = noise::<f32>(n, 10 + step);
            let [p, m, v] = &mut sparse;
            settings.step_rows(step, p, &g, m, v, SparseRows { rows: &all, row_steps: &mut row_steps });
            let [p, m, v] = &mut dense;
            settings.step(step, p, &g, m, v);
        }
        prop_assert_eq!(sparse, dense);
    }
}

#[test]
fn no_rows_at_all() {
    let settings = AdamW { rate: 0.1, beta1: 0.9, beta2: 0.99, eps: 1e-8, weight_decay: 0.1, gradient_scale: 1.0 };
    settings.step_rows(1, &mut [], &[], &mut [], &mut [], SparseRows { rows: &[], row_steps: &mut [] });
    let (mut p, mut row_steps) = ([1.0], [0]);
    let rows = SparseRows { rows: &[], row_steps: &mut row_steps };
    settings.step_rows(1, &mut p, &[9.0], &mut [0.0], &mut [0.0], rows);
    assert_eq!((p, row_steps), ([1.0], [0]));
}

#[test]
#[should_panic(expected = "AdamW: row 2 of 2")]
fn a_row_that_is_not_there_is_refused() {
    let settings = AdamW { rate: 0.1, beta1: 0.9, beta2: 0.99, eps: 1e-8, weight_decay: 0.1, gradient_scale: 1.0 };
    let rows = SparseRows { rows: &[2], row_steps: &mut [0, 0] };
    settings.step_rows(1, &mut [1.0; 2], &[1.0; 2], &mut [0.0; 2], &mut [0.0; 2], rows);
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
