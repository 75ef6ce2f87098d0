//! Ops: gradients against differences, values against slow twins, linear ones against their adjoints.

use proptest::prelude::*;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, adjoint_check, gradcheck};
use weaver_vad::ops::{binary_cross_entropy, conv1d, decay_attention, mean_at_top_k, top_k_mean};

/// Few cases: every one of them tries many coordinates and directions. More where `PROPTEST_CASES` asks for more.
fn cases() -> ProptestConfig {
    let default = ProptestConfig::default();
    ProptestConfig { cases: (default.cases / 20).max(1), failure_persistence: None, ..default }
}

/// Numbers of which no two are within reach of a difference.
fn apart(seed: u64, shape: [usize; 2]) -> Input {
    let mut x = Input::normal(seed, shape);
    let mut order: Vec<usize> = (0..x.data.len()).collect();
    order.sort_by(|a, b| x.data[*a].total_cmp(&x.data[*b]));
    order.into_iter().enumerate().for_each(|(rank, i)| x.data[i] += 0.05 * rank as f64);
    x
}

proptest! {
    #![proptest_config(cases())]

    #[test]
    fn top_k(rows in 0usize..4, width in 1usize..7, more in 0usize..6, seed: u64) {
        let (x, k) = (apart(seed, [rows, width]), 1 + more % width);
        gradcheck(std::slice::from_ref(&x), |x| vec![top_k_mean(x[0], k)]);
        let tape = Tape::<f64>::new();
        let found = top_k_mean(tape.constant(&x.data, x.shape), k).to_vec();
        for (row, found) in x.data.chunks_exact(width).zip(found) {
            let mut sorted = row.to_vec();
            sorted.sort_by(|a, b| b.total_cmp(a));
            prop_assert!((sorted[..k].iter().sum::<f64>() / k as f64 - found).abs() < 1e-12);
        }
    }

    #[test]
    fn rows_at_top_k(batch in 1usize..3, time in 1usize..5, width in 1usize..4, seed: u64) {
        let (x, by) = (Input::normal(seed, [batch, time, width]), apart(!seed, [batch, time]).constant());
        gradcheck(&[x, by], |x| vec![mean_at_top_k(x[0], x[1], time.div_ceil(2))]);
    }

    #[test]
    fn cross_entropy(n in 0usize..9, seed: u64) {
        let (p, y) = (Input::uniform(seed, 0.05, 0.95, [n]), Input::uniform(!seed, 0.0, 1.0, [n]).constant());
        gradcheck(&[p.clone(), y.clone()], |x| vec![binary_cross_entropy(x[0], x[1])]);
        let tape = Tape::<f64>::new();
        let found = binary_cross_entropy(tape.constant(&p.data, [n]), tape.constant(&y.data, [n])).item();
        let term = |(p, y): (&f64, &f64)| -(y * p.ln() + (1.0 - y) * (1.0 - p).ln());
        let expected = p.data.iter().zip(&y.data).map(term).sum::<f64>() / n.max(1) as f64;
        prop_assert!((found - expected).abs() < 1e-12);
    }

    #[test]
    fn attention_by_distance(batch in 0usize..3, time in 1usize..9, width in 1usize..4, seed: u64) {
        adjoint_check([batch, time, width], seed, decay_attention);
        let x = Input::normal(seed, [batch, time, width]);
        gradcheck(std::slice::from_ref(&x), |x| vec![decay_attention(x[0])]);
        // The matrix as it is written down.
        let weight = |i: usize, j: usize| (-(i.abs_diff(j) as f64) / std::f64::consts::E).exp();
        let sums: Vec<f64> = (0..time).map(|j| (0..time).map(|i| weight(i, j)).sum()).collect();
        let tape = Tape::<f64>::new();
        let found = decay_attention(tape.constant(&x.data, x.shape)).to_vec();
        for (at, found) in found.into_iter().enumerate() {
            let (b, i, d) = (at / (time * width), at / width % time, at % width);
            let expected: f64 = (0..time).map(|j| weight(i, j) / sums[j] * x.data[(b * time + j) * width + d]).sum();
            prop_assert!((found - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn convolution(batch in 0usize..3, time in 1usize..7, inputs in 1usize..4, outputs in 1usize..3, dilation in 1usize..4, seed: u64) {
        let x = Input::normal(seed, [batch, time, inputs]);
        let (w, b) = (Input::normal(seed ^ 1, [outputs, inputs, 3]), Input::normal(seed ^ 2, [outputs]));
        gradcheck(&[x.clone(), w.clone(), b.clone()], |v| vec![conv1d(v[0], v[1], v[2], dilation)]);
        let tape = Tape::<f64>::new();
        let constant = |x: &Input| tape.constant(&x.data, x.shape);
        let found = conv1d(constant(&x), constant(&w), constant(&b), dilation).to_vec();
        for (at, found) in found.into_iter().enumerate() {
            let (n, t, o) = (at / (time * outputs), at / outputs % time, at % outputs);
            let mut expected = b.data[o];
            for tap in 0..3 {
                let from = t as isize + (tap as isize - 1) * dilation as isize;
                if (0..time as isize).contains(&from) {
                    expected += (0..inputs)
                        .map(|i| w.data[(o * inputs + i) * 3 + tap] * x.data[(n * time + from as usize) * inputs + i])
                        .sum::<f64>();
                }
            }
            prop_assert!((found - expected).abs() < 1e-12);
        }
    }
}

#[test]
fn of_equal_numbers_the_first_count() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&[1.0, 2.0, 2.0, 2.0], [1, 4]);
    top_k_mean(x, 2).sum().backward();
    assert_eq!(x.grad().unwrap(), [0.0, 0.5, 0.5, 0.0]);
}

/// Certain probabilities have finite losses and gradients.
#[test]
fn certain_probabilities_have_finite_losses() {
    let tape = Tape::<f32>::new();
    let p = tape.leaf(&[0.0, 1.0], [2]);
    let loss = binary_cross_entropy(p, tape.constant(&[1.0, 0.0], [2]));
    loss.backward();
    assert_eq!(loss.item(), 100.0);
    assert!(p.grad().unwrap().iter().all(|g| g.is_finite()));
}
