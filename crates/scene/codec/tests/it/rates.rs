//! Quantizers and rates: bounds of the error, derivatives by differences, probabilities that add up.

use proptest::prelude::*;
use weaver_codec::{FactorizedPrior, PRIOR_PARAMETERS, Quantizer, binary, gaussian_rate};
use weaver_kernels::random::Stream;

fn slope(f: impl Fn(f64) -> f64, x: f64) -> f64 {
    let h = 1e-5 * (1.0 + x.abs());
    (f(x + h) - f(x - h)) / (2.0 * h)
}

fn near(found: f64, expected: f64) -> bool {
    (found - expected).abs() <= 1e-6 * (1.0 + expected.abs())
}

proptest! {
    #[test]
    fn errors_stay_within_half_a_step(x in -1e4..1e4_f64, step in 0.01..3.0_f64, dead_zone in 0.0..0.45_f64) {
        let quantizer = Quantizer { step, dead_zone };
        let symbol = quantizer.symbol(x);
        let error = (quantizer.value(symbol) - x).abs();
        prop_assert!(error <= step * (0.5 + dead_zone) * (1.0 + 1e-9));
        prop_assert!(dead_zone > 0.0 || quantizer.symbol(quantizer.value(symbol)) == symbol);
        prop_assert_eq!(quantizer.symbol(-x), -symbol);
    }

    #[test]
    fn gaussian_rates_have_their_derivatives(x in -8..9, mean in -3.0..3.0_f64, deviation in 0.3..4.0_f64, step in 0.2..2.0_f64) {
        let x = f64::from(x) * step;
        let rate = gaussian_rate(x, mean, deviation, step);
        prop_assume!(rate.bits < 19.9);
        prop_assert!(near(rate.by_x, slope(|x| gaussian_rate(x, mean, deviation, step).bits, x)));
        prop_assert!(near(-rate.by_x, slope(|mean| gaussian_rate(x, mean, deviation, step).bits, mean)));
        prop_assert!(near(rate.by_deviation, slope(|s| gaussian_rate(x, mean, s, step).bits, deviation)));
        prop_assert!(near(rate.by_step, slope(|q| gaussian_rate(x, mean, deviation, q).bits, step)));
    }

    #[test]
    fn prior_has_its_derivatives(x in -12.0..12.0_f64, seed in 0..1000_u64) {
        let random = Stream::new(seed, 0, "codec.prior");
        let mut prior = FactorizedPrior::new(4.0);
        for (i, parameter) in prior.parameters.iter_mut().enumerate() {
            *parameter += 0.5 * random.normal::<f64>(i as u64);
        }
        let rate = prior.rate(x);
        prop_assume!(rate.bits < 19.9);
        prop_assert!(near(rate.by_x, slope(|x| prior.rate(x).bits, x)));
        for i in 0..PRIOR_PARAMETERS {
            let at = |value| {
                let mut prior = prior.clone();
                prior.parameters[i] = value;
                prior.rate(x).bits
            };
            prop_assert!(near(rate.by_parameters[i], slope(at, prior.parameters[i])), "parameter {}", i);
        }
    }
}

#[test]
fn probabilities_of_all_symbols_add_up() {
    let prior = FactorizedPrior::new(10.0);
    let total = |bits: &dyn Fn(f64) -> f64| (-400..=400).map(|i| (-bits(f64::from(i))).exp2()).sum::<f64>();
    // Symbols below the least probability have that one.
    assert!((total(&|x| prior.rate(x).bits) - 1.0).abs() < 1.5e-3);
    assert!((total(&|x| gaussian_rate(x, 0.3, 2.0, 1.0).bits) - 1.0).abs() < 1.5e-3);
    assert!(prior.cumulative(-1e3) < 1e-9 && prior.cumulative(1e3) > 1.0 - 1e-9);
}

#[test]
fn improbable_numbers_still_descend() {
    let far = gaussian_rate(9.0, 0.0, 1.0, 1.0);
    assert!((far.bits - 1e6_f64.log2()).abs() < 1e-9 && far.by_x > 0.0 && far.by_deviation < 0.0);
    assert!(gaussian_rate(0.0, 0.0, 0.0, 1.0).bits.abs() < 1e-12);
    for x in [f64::MAX, 0.0, -1e300] {
        let rate = gaussian_rate(x, 0.0, 1e-12, 1.0);
        assert!(rate.bits.is_finite() && rate.by_x.is_finite() && rate.by_deviation.is_finite());
    }
}

#[test]
fn binary_numbers() {
    assert_eq!([-0.1, 0.0, 3.0].map(binary), [-1.0, 1.0, 1.0]);
}

#[test]
fn symbols_are_clamped() {
    let quantizer = Quantizer { step: 1e-3, dead_zone: 0.0 };
    let largest = (1 << 24) - 1;
    assert_eq!([1e30, -1e30, f64::INFINITY, f64::NAN].map(|x| quantizer.symbol(x)), [largest, -largest, largest, 0]);
}
