//! Ops: gradients against differences, values against slow twins, adjoints.

use proptest::prelude::*;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, adjoint_check, gradcheck};
use weaver_vad::ops::decay_attention;

/// A twentieth of the default or of `PROPTEST_CASES`: every case tries many coordinates and directions.
fn cases() -> ProptestConfig {
    let default = ProptestConfig::default();
    ProptestConfig { cases: (default.cases / 20).max(1), failure_persistence: None, ..default }
}

proptest! {
    #![proptest_config(cases())]

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
}
