//! Losses, and the small ops around them.

use crate::strategies::{away_from_zero, cases, dim, length};
use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::{Tape, ops};
use weaver_kernels::random::Stream;

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn cross_entropy(rows in dim(), classes in length(), smoothing in 0.0..0.5, seed: u64) {
        let stream = Stream::new(seed, 0, "test.labels");
        let labels: Vec<u32> = (0..rows as u64).map(|i| stream.below(i, classes) as u32).collect();
        let x = Input::normal(seed, [rows, classes]);
        gradcheck(std::slice::from_ref(&x), |x| vec![ops::cross_entropy(x[0], &labels, smoothing)]);
        let tape = Tape::<f64>::new();
        let logits = tape.constant(&x.data, x.shape);
        let log = logits.log_softmax(1).to_vec();
        let target = |i: usize| smoothing / classes as f64 + if labels[i / classes] as usize == i % classes { 1.0 - smoothing } else { 0.0 };
        let expected = -(0..log.len()).map(|i| target(i) * log[i]).sum::<f64>() / rows.max(1) as f64;
        prop_assert!((ops::cross_entropy(logits, &labels, smoothing).item() - expected).abs() < 1e-12);
    }

    #[test]
    fn binary_cross_entropy(n in 0usize..9, seed: u64) {
        let (p, y) = (Input::uniform(seed, 0.05, 0.95, [n]), Input::uniform(!seed, 0.0, 1.0, [n]).constant());
        gradcheck(&[p.clone(), y.clone()], |x| vec![ops::binary_cross_entropy(x[0], x[1])]);
        let tape = Tape::<f64>::new();
        let found = ops::binary_cross_entropy(tape.constant(&p.data, [n]), tape.constant(&y.data, [n])).item();
        let term = |(p, y): (&f64, &f64)| -(y * p.ln() + (1.0 - y) * (1.0 - p).ln());
        let expected = p.data.iter().zip(&y.data).map(term).sum::<f64>() / n.max(1) as f64;
        prop_assert!((found - expected).abs() < 1e-12);
    }

    #[test]
    fn huber(n in dim(), delta in 0.1..2.0, seed: u64) {
        // The second derivative jumps at delta; the first does not.
        gradcheck(&[Input::normal(seed, [n]), Input::normal(!seed, [n])], |x| vec![ops::huber(x[0], x[1], delta)]);
    }

    #[test]
    fn scale_residual(rows in dim(), width in dim(), seed: u64) {
        let inputs = [Input::normal(seed, [rows, width]), Input::normal(seed ^ 1, [width]), Input::normal(seed ^ 2, [rows, width])];
        gradcheck(&inputs, |x| vec![ops::scale_residual(x[0], x[1], x[2])]);
        let tape = Tape::<f64>::new();
        let [x, gamma, y] = inputs.map(|x| tape.constant(&x.data, x.shape));
        prop_assert_eq!(ops::scale_residual(x, gamma, y).to_vec(), (x + gamma.expand([rows, width]) * y).to_vec());
    }

    #[test]
    fn normalize_rows(rows in dim(), width in length(), seed: u64) {
        gradcheck(&[away_from_zero(seed, 0.3, [rows, width])], |x| vec![x[0].normalize_rows(1e-3)]);
        let tape = Tape::<f64>::new();
        let y = tape.constant(&Input::normal(seed, [rows, width]).data, [rows, width]).normalize_rows(0.0);
        prop_assert!(y.square().sum_axis(1).to_vec().iter().all(|s| (s - 1.0).abs() < 1e-14));
    }
}

/// Certain probabilities have finite losses and gradients.
#[test]
fn certain_probabilities_have_finite_losses() {
    let tape = Tape::<f32>::new();
    let p = tape.leaf(&[0.0, 1.0], [2]);
    let loss = ops::binary_cross_entropy(p, tape.constant(&[1.0, 0.0], [2]));
    loss.backward();
    assert_eq!(loss.item(), 100.0);
    assert!(p.grad().unwrap().iter().all(|g| g.is_finite()));
}

#[test]
fn huber_on_both_sides() {
    let tape = Tape::<f64>::new();
    let (x, y) = (tape.leaf(&[0.5, 3.0, -3.0, 1.0], [4]), tape.scalar(0.0));
    let loss = ops::huber(x, y, 1.0);
    loss.sum().backward();
    assert_eq!(loss.to_vec(), [0.125, 2.5, 2.5, 0.5]);
    assert_eq!(x.grad().unwrap(), [0.5, 1.0, -1.0, 1.0]);
}

/// Straight through takes the value of one and the gradient of the other.
#[test]
fn straight_through_has_value_and_gradient() {
    let tape = Tape::<f64>::new();
    let (soft, hard) = (tape.leaf(&[0.7, 0.3], [2]), tape.leaf(&[1.0, 0.0], [2]));
    let y = ops::straight_through(soft, hard);
    (y * tape.constant(&[2.0, 3.0], [2])).sum().backward();
    assert_eq!((y.to_vec(), soft.grad().unwrap(), hard.grad()), (vec![1.0, 0.0], vec![2.0, 3.0], None));
}

#[test]
fn a_row_of_zeros_has_no_direction() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&[0.0, 0.0, 3.0, 4.0], [2, 2]);
    let y = x.normalize_rows(1e-10);
    y.sum().backward();
    assert_eq!(y.to_vec()[..2], [0.0, 0.0]);
    assert_eq!(x.grad().unwrap()[..2], [0.0, 0.0]);
}

#[test]
fn a_row_of_zeros_stays_zero_without_eps() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&[0.0, 0.0, 3.0, 4.0], [2, 2]);
    let y = x.normalize_rows(0.0);
    y.sum().backward();
    assert_eq!(y.to_vec(), [0.0, 0.0, 3.0 * (1.0 / 5.0), 4.0 * (1.0 / 5.0)]);
    assert_eq!(x.grad().unwrap()[..2], [0.0, 0.0]);
}

#[test]
fn nan_fills_its_row_and_no_other() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&[f64::NAN, 1.0, 3.0, 4.0], [2, 2]);
    let y = x.normalize_rows(0.0);
    y.sum().backward();
    for numbers in [y.to_vec(), x.grad().unwrap()] {
        assert_eq!(numbers.iter().map(|x| x.is_nan()).collect::<Vec<_>>(), [true, true, false, false]);
    }
}

#[test]
fn a_masked_class_costs_nothing() {
    let tape = Tape::<f64>::new();
    let logits = tape.leaf(&[0.0, f64::NEG_INFINITY], [1, 2]);
    let loss = ops::cross_entropy(logits, &[0], 0.0);
    loss.backward();
    assert_eq!((loss.item(), logits.grad().unwrap()), (0.0, vec![0.0, 0.0]));
    // With smoothing it is asked for, and impossible.
    assert_eq!(ops::cross_entropy(logits, &[0], 0.1).item(), f64::INFINITY);
    // With nothing but smoothing, the label does not count.
    let masked = tape.constant(&[0.0, 0.0, f64::NEG_INFINITY], [1, 3]);
    assert_eq!(ops::cross_entropy(masked, &[2], 0.0).item(), f64::INFINITY);
    assert_eq!(ops::cross_entropy(masked, &[2], 1.0).item(), f64::INFINITY);
}
