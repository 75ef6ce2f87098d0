//! The largest numbers of rows against a sort.

use crate::strategies::cases;
use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::{Tape, ops};

/// Numbers of which no two are within reach of a difference.
fn apart(seed: u64, shape: [usize; 2]) -> Input {
    let mut x = Input::normal(seed, shape);
    let mut order: Vec<usize> = (0..x.data.len()).collect();
    order.sort_by(|a, b| x.data[*a].total_cmp(&x.data[*b]));
    order.into_iter().enumerate().for_each(|(rank, i)| x.data[i] += 0.05 * rank as f64);
    x
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn top_k_mean(rows in 0usize..4, width in 1usize..7, more in 0usize..6, seed: u64) {
        let (x, k) = (apart(seed, [rows, width]), 1 + more % width);
        gradcheck(std::slice::from_ref(&x), |x| vec![ops::top_k_mean(x[0], k)]);
        let tape = Tape::<f64>::new();
        let found = ops::top_k_mean(tape.constant(&x.data, x.shape), k).to_vec();
        for (row, found) in x.data.chunks_exact(width).zip(found) {
            let mut sorted = row.to_vec();
            sorted.sort_by(|a, b| b.total_cmp(a));
            prop_assert!((sorted[..k].iter().sum::<f64>() / k as f64 - found).abs() < 1e-12);
        }
    }

    #[test]
    fn rows_at_top_k(batch in 1usize..3, time in 1usize..5, width in 1usize..4, seed: u64) {
        let (x, by) = (Input::normal(seed, [batch, time, width]), apart(!seed, [batch, time]).constant());
        gradcheck(&[x, by], |x| vec![ops::mean_at_top_k(x[0], x[1], time.div_ceil(2))]);
    }
}

#[test]
fn of_equal_numbers_the_first_count() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&[1.0, 2.0, 2.0, 2.0], [1, 4]);
    ops::top_k_mean(x, 2).sum().backward();
    assert_eq!(x.grad().unwrap(), [0.0, 0.5, 0.5, 0.0]);
}
