//! Attention against its parts.

use crate::strategies::{cases, length};
use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::{Tape, Var, ops};

/// softmax(scale q k^T) v, with every score in memory.
fn twin<'t>(q: Var<'t, f64>, k: Var<'t, f64>, v: Var<'t, f64>, scale: f64) -> Var<'t, f64> {
    let heads_first = |x: Var<'t, f64>| x.permute(&[0, 2, 1, 3]);
    let scores = heads_first(q).matmul_with(heads_first(k), false, true) * scale;
    scores.softmax(3).matmul(heads_first(v)).permute(&[0, 2, 1, 3])
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn attention(batch in 0usize..3, queries in 0usize..6, keys in length(), heads in length(), dim in length(), seed: u64) {
        let shapes = [[batch, queries, heads, dim], [batch, keys, heads, dim], [batch, keys, heads, dim]];
        let inputs: Vec<Input> = (0..3).map(|i| Input::normal(seed ^ i, shapes[i as usize])).collect();
        gradcheck(&inputs, |x| vec![ops::attention(x[0], x[1], x[2], 0.7)]);
        let tape = Tape::<f64>::new();
        let x: Vec<_> = inputs.iter().map(|x| tape.constant(&x.data, x.shape)).collect();
        let pairs = ops::attention(x[0], x[1], x[2], 0.7).to_vec().into_iter().zip(twin(x[0], x[1], x[2], 0.7).to_vec());
        for (y, expected) in pairs {
            prop_assert!((y - expected).abs() < 1e-12);
        }
    }
}

/// An attention of q, k and v with a scale.
type Function = for<'t> fn(Var<'t, f64>, Var<'t, f64>, Var<'t, f64>, f64) -> Var<'t, f64>;

/// Long enough for several tiles of queries and keys.
#[test]
fn several_tiles() {
    let inputs: Vec<Input> = (0..3).map(|i| Input::normal(i, [1, 200, 2, 8])).collect();
    let gradients = |f: Function| {
        let tape = Tape::<f64>::new();
        let x: Vec<_> = inputs.iter().map(|x| tape.leaf(&x.data, x.shape)).collect();
        let y = f(x[0], x[1], x[2], 0.35);
        y.backward_with(&Input::normal(9, y.shape()).data);
        (y.to_vec(), x.iter().map(|x| x.grad().expect("a gradient")).collect::<Vec<_>>())
    };
    let ((y, grads), (expected, expected_grads)) = (gradients(ops::attention), gradients(twin));
    let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
    assert!(close(&y, &expected));
    assert!(grads.iter().zip(&expected_grads).all(|(a, b)| close(a, b)));
}
