//! Elementwise functions of one tensor.

use crate::strategies::{away_from_zero, cases, shape};
use proptest::prelude::*;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, gradcheck};

proptest! {
    #![proptest_config(cases(8))]

    #[test]
    fn smooth_functions(shape in shape(2), seed: u64) {
        gradcheck(&[Input::normal(seed, shape)], |x| {
            let x = x[0];
            vec![x.gelu(), x.sigmoid(), x.tanh(), x.silu(), x.softplus(), x.exp(), x.square()]
        });
    }

    #[test]
    fn functions_of_positive_numbers(shape in shape(2), seed: u64) {
        gradcheck(&[Input::uniform(seed, 0.2, 4.0, shape)], |x| vec![x[0].ln(), x[0].sqrt()]);
    }

    #[test]
    fn functions_with_a_kink(shape in shape(2), seed: u64) {
        gradcheck(&[away_from_zero(seed, 1e-3, shape)], |x| vec![x[0].relu(), x[0].abs(), x[0].clamp(0.0, 40.0)]);
    }
}

/// Value and derivative at one point, in `f32`.
fn at(x: f32, f: impl for<'t> Fn(weaver_autograd::Var<'t, f32>) -> weaver_autograd::Var<'t, f32>) -> (f32, f32) {
    let tape = Tape::<f32>::new();
    let x = tape.leaf(&[x], [1]);
    let y = f(x);
    y.backward();
    (y.item(), x.grad().expect("a gradient")[0])
}

#[test]
fn clamp_passes_the_gradient_at_its_bounds() {
    assert_eq!(at(0.0, |x| x.clamp(0.0, 1.0)), (0.0, 1.0));
    assert_eq!(at(1.0, |x| x.clamp(0.0, 1.0)), (1.0, 1.0));
    assert_eq!(at(-1e-7, |x| x.clamp(0.0, 1.0)), (0.0, 0.0));
    assert_eq!(at(1.000_001, |x| x.clamp(0.0, 1.0)), (1.0, 0.0));
    assert!(at(f32::NAN, |x| x.clamp(0.0, 1.0)).0.is_nan());
}

#[test]
fn kinks_and_extremes() {
    assert_eq!((at(0.0, |x| x.relu()), at(0.0, |x| x.abs())), ((0.0, 0.0), (0.0, 0.0)));
    assert_eq!(at(f32::NEG_INFINITY, |x| x.relu()), (0.0, 0.0));
    assert!(at(f32::NAN, |x| x.relu()).0.is_nan());
    assert_eq!((at(-200.0, |x| x.sigmoid()), at(200.0, |x| x.sigmoid())), ((0.0, 0.0), (1.0, 0.0)));
    assert_eq!((at(-200.0, |x| x.softplus()), at(200.0, |x| x.softplus())), ((0.0, 0.0), (200.0, 1.0)));
    assert_eq!((at(-200.0, |x| x.silu()), at(200.0, |x| x.silu())), ((0.0, 0.0), (200.0, 1.0)));
    assert_eq!((at(-200.0, |x| x.tanh()), at(200.0, |x| x.tanh())), ((-1.0, 0.0), (1.0, 0.0)));
}
