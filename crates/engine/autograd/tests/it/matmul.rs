//! Matrix products and fully connected layers.

use crate::strategies::{cases, dim};
use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::ops::{Activation, linear};
use weaver_autograd::{Shape, Tape, Var};

/// `[lead.., rows, cols]`, the last two exchanged if `trans`.
fn stored(lead: &[usize], rows: usize, cols: usize, trans: bool) -> Shape {
    let last = if trans { [cols, rows] } else { [rows, cols] };
    Shape::new(&[lead, &last].concat())
}

fn layer<'t>(x: &[Var<'t, f64>], activation: Activation) -> Var<'t, f64> {
    linear(x[0], x[1], x.get(2).copied(), activation)
}

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn matmul(batch in dim(), heads in dim(), m in dim(), n in dim(), k in dim(), ta: bool, tb: bool, shared: bool, seed: u64) {
        let lead = [batch, heads];
        let a = Input::normal(seed, stored(&lead, m, k, ta));
        let b = Input::normal(!seed, stored(if shared { &[] } else { &lead }, k, n, tb));
        gradcheck(&[a.clone(), b.clone()], |x| vec![x[0].matmul_with(x[1], ta, tb)]);

        let tape = Tape::<f64>::new();
        let y = tape.constant(&a.data, a.shape).matmul_with(tape.constant(&b.data, b.shape), ta, tb);
        prop_assert_eq!(y.shape(), Shape::from([batch, heads, m, n]));
        for (at, y) in y.to_vec().into_iter().enumerate() {
            let (e, i, j) = (at / (m * n), at / n % m, at % n);
            let b_start = if shared { 0 } else { e * k * n };
            let product = |p: usize| {
                let a_at = e * m * k + if ta { p * m + i } else { i * k + p };
                let b_at = b_start + if tb { j * k + p } else { p * n + j };
                a.data[a_at] * b.data[b_at]
            };
            prop_assert!((y - (0..k).map(product).sum::<f64>()).abs() < 1e-12);
        }
    }

    #[test]
    fn fused_linear(rows in dim(), n in dim(), k in dim(), bias: bool, seed: u64) {
        let mut inputs = vec![Input::normal(seed, [2, rows, k]), Input::normal(seed ^ 1, [n, k])];
        if bias {
            inputs.push(Input::normal(seed ^ 2, [n]));
        }
        gradcheck(&inputs, |x| vec![layer(x, Activation::None), layer(x, Activation::Gelu)]);

        // The twin in parts.
        let tape = Tape::<f64>::new();
        let x: Vec<_> = inputs.iter().map(|x| tape.leaf(&x.data, x.shape)).collect();
        let mut sums = x[0].matmul_with(x[1], false, true);
        if bias {
            sums = sums + x[2].expand(sums.shape());
        }
        let pairs = [(Activation::None, sums), (Activation::Relu, sums.relu()), (Activation::Gelu, sums.gelu())];
        for (activation, expected) in pairs {
            for (y, e) in layer(&x, activation).to_vec().into_iter().zip(expected.to_vec()) {
                prop_assert!((y - e).abs() < 1e-12 * (1.0 + e.abs()));
            }
        }
    }
}

#[test]
fn relu_passes_what_is_positive() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&[1.0, -2.0, 0.0], [3, 1]);
    let w = tape.leaf(&[2.0], [1, 1]);
    let y = linear(x, w, None, Activation::Relu);
    y.sum().backward();
    assert_eq!(
        (y.to_vec(), x.grad().unwrap(), w.grad().unwrap()),
        (vec![2.0, 0.0, 0.0], vec![2.0, 0.0, 0.0], vec![1.0])
    );
}

#[test]
fn wrong_shapes_are_named() {
    let tape = Tape::<f64>::new();
    let (x, w) = (tape.constant(&[0.0; 6], [2, 3]), tape.constant(&[0.0; 8], [2, 4]));
    let layer = || tape.part("block.3.mlp.fc1", || linear(x, w, None, Activation::None));
    let message = *std::panic::catch_unwind(std::panic::AssertUnwindSafe(layer))
        .expect_err("3 is not 4")
        .downcast::<String>()
        .expect("a formatted message");
    assert_eq!(message, "block.3.mlp.fc1: linear: expected x [.., in], w [out, in], b [out], found [2, 3], [2, 4]");
}
