//! Order statistics against a sort.

use proptest::prelude::*;
use weaver_kernels::Real;
use weaver_kernels::order::{ascending, median_high, median_mean, nth, quantile};

/// Few different numbers, so that many are equal, and those at the ends of the order.
fn values() -> impl Strategy<Value = Vec<f64>> {
    let value =
        prop_oneof![8 => (-3..4).prop_map(f64::from), 2 => -1.0..1.0, 1 => Just(-0.0), 1 => Just(f64::INFINITY)];
    prop::collection::vec(value, 0..20)
}

fn check<T: Real>(values: &[f64]) {
    let values: Vec<T> = values.iter().map(|x| T::from_f64(*x)).collect();
    let mut sorted = values.clone();
    sorted.sort_by(ascending);
    let bits = |x: Option<T>| x.map(|x| x.to_f64().to_bits());
    let n = values.len();
    for rank in 0..=n {
        assert_eq!(bits(nth(&mut values.clone(), rank)), bits(sorted.get(rank).copied()));
    }
    assert_eq!(bits(median_high(&mut values.clone())), bits(sorted.get(n / 2).copied()));
    let Some(last) = n.checked_sub(1) else {
        assert_eq!(bits(median_mean(&mut values.clone())), None);
        return;
    };
    let [lower, upper] = [sorted[last / 2], sorted[n / 2]];
    let mean = if last / 2 == n / 2 { upper } else { (lower + upper) / T::from_f64(2.0) };
    assert_eq!(bits(median_mean(&mut values.clone())), bits(Some(mean)));
    for q in [0.0, 0.1, 0.5, 0.77, 1.0] {
        let position = q * last as f64;
        let [lower, upper] = [position.floor(), position.ceil()].map(|at| sorted[at as usize]);
        let expected =
            if position.fract() == 0.0 { lower } else { lower + (upper - lower) * T::from_f64(position.fract()) };
        assert_eq!(bits(Some(quantile(&mut values.clone(), q))), bits(Some(expected)), "{q}");
    }
}

proptest! {
    #[test]
    fn places_of_the_sorted_sequence(values in values()) {
        check::<f32>(&values);
        check::<f64>(&values);
    }
}

#[test]
fn nan_stands_at_the_ends() {
    let mut values = [1.0, f64::NAN, -f64::NAN, 2.0, 0.0];
    assert_eq!(median_high(&mut values), Some(1.0));
    assert_eq!(nth(&mut values, 3), Some(2.0));
    assert!(nth(&mut values, 4).is_some_and(f64::is_nan));
}
