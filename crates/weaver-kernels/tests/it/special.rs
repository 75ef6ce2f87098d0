//! exp, tanh and erf against `f64` and against series.

use weaver_kernels::Real;
use weaver_kernels::erf::{erf_f32, erf_f64};
use weaver_kernels::exp::{exp_f32, tanh_f32};
use weaver_kernels::simd;

/// Distance from the exact value in units of the last place of `f32`.
fn ulps(got: f32, exact: f64) -> f64 {
    let e = exact as f32;
    let spacing = f64::from(f32::from_bits(e.abs().to_bits() + 1)) - f64::from(e.abs());
    (f64::from(got) - exact).abs() / spacing
}

/// Every `stride`-th positive float from `from` to `to`, and its negative.
fn floats(from: f32, to: f32, stride: usize) -> impl Iterator<Item = f32> {
    (from.to_bits()..=to.to_bits()).step_by(stride).flat_map(|b| [f32::from_bits(b), -f32::from_bits(b)])
}

fn worst(f: impl Fn(f32) -> f32, exact: impl Fn(f64) -> f64, xs: impl Iterator<Item = f32>) -> f64 {
    xs.map(|x| ulps(f(x), exact(f64::from(x)))).fold(0.0, f64::max)
}

#[test]
fn exp_is_accurate() {
    let error = worst(exp_f32, f64::exp, floats(1e-10, 87.3, 997));
    assert!(error < 1.2, "{error} ulp");
    for (x, y) in [
        (0.0, 1.0),
        (-0.0, 1.0),
        (f32::INFINITY, f32::INFINITY),
        (f32::NEG_INFINITY, 0.0),
        (200.0, f32::INFINITY),
        (-200.0, 0.0),
    ] {
        assert_eq!(exp_f32(x), y, "exp({x})");
    }
    assert!(exp_f32(f32::NAN).is_nan());
    // Subnormal results: half a spacing of the smallest number, and a little.
    for x in [-88.0_f32, -95.0, -100.0, -103.0] {
        assert!((f64::from(exp_f32(x)) - f64::from(x).exp()).abs() < 1.5e-45, "exp({x})");
    }
}

#[test]
fn tanh_is_accurate() {
    let error = worst(tanh_f32, f64::tanh, floats(1e-10, 20.0, 997));
    assert!(error < 2.5, "{error} ulp");
    assert_eq!(tanh_f32(0.0), 0.0);
    assert_eq!((tanh_f32(f32::INFINITY), tanh_f32(f32::NEG_INFINITY)), (1.0, -1.0));
    assert!(tanh_f32(f32::NAN).is_nan());
}

#[test]
fn erf_f32_is_accurate() {
    let error = worst(erf_f32, erf_f64, floats(1e-10, 6.0, 997));
    assert!(error < 1.5, "{error} ulp");
    assert_eq!((erf_f32(f32::INFINITY), erf_f32(f32::NEG_INFINITY)), (1.0, -1.0));
    assert!(erf_f32(f32::NAN).is_nan());
}

/// erf by its series with all terms positive, erf x = 2/sqrt(pi) e^{-x^2} sum 2^n x^{2n+1} / (2n+1)!!.
fn erf_series(x: f64) -> f64 {
    let (mut term, mut sum, mut n) = (x, x, 0.0);
    while term > 1e-18 * sum {
        n += 1.0;
        term *= 2.0 * x * x / (2.0 * n + 1.0);
        sum += term;
    }
    sum * (-x * x).exp() * std::f64::consts::FRAC_2_SQRT_PI
}

/// erfc by its continued fraction, for large arguments.
fn erfc_fraction(x: f64) -> f64 {
    let f = (1..=120).rev().fold(0.0, |f, k| f64::from(k) / 2.0 / (x + f));
    (-x * x).exp() / ((x + f) * std::f64::consts::PI.sqrt())
}

/// Values computed with 40 digits.
#[test]
fn erf_f64_is_within_an_ulp_and_a_half() {
    for (x, exact) in [
        (0.015625, 0.017629489782642005),
        (0.046875, 0.052854059156443735),
        (0.109375, 0.12292609335484639),
        (0.1875, 0.20911767705937584),
        (0.3125, 0.341468633501595),
        (0.421875, 0.4492397840746943),
        (0.515625, 0.5341230345484599),
        (0.625, 0.623240882188418),
        (0.734375, 0.700992018342234),
        (0.7421875, 0.7061032914157314),
        (0.8125, 0.749464025586362),
        (0.90625, 0.800027894164233),
        (0.953125, 0.8223166257085084),
        (0.9984375, 0.8420511735115331),
        (1.0, 0.8427007929497149),
        (1.0625, 0.8670582694349528),
        (1.15625, 0.8979896092070178),
        (1.25, 0.9229001282564583),
        (1.40625, 0.953269851028023),
        (1.5, 0.9661051464753108),
        (1.7, 0.9837904585907745),
        (1.9, 0.9927904292352575),
        (2.0, 0.9953222650189527),
        (2.25, 0.9985372834133188),
        (2.5, 0.999593047982555),
        (2.8, 0.9999249868053346),
        (3.0, 0.9999779095030014),
        (3.3, 0.9999969422902035),
        (3.6, 0.999999644137007),
        (4.0, 0.9999999845827421),
        (4.5, 0.9999999998033839),
        (5.0, 0.9999999999984626),
        (5.5, 0.9999999999999927),
        (5.8, 0.9999999999999998),
    ] {
        let spacing = f64::from_bits(f64::to_bits(exact) + 1) - exact;
        // One rounding of the tabulated value is allowed for.
        assert!((erf_f64(x) - exact).abs() <= 1.5 * spacing, "erf({x})");
    }
}

#[test]
fn erf_f64_is_accurate() {
    for i in 1..6500 {
        let x = f64::from(i) * 1e-3;
        // The series itself is only good to some units in the last place.
        let (exact, tolerance) = if x < 1.5 { (erf_series(x), 1e-15) } else { (1.0 - erfc_fraction(x), 3e-16) };
        let error = (erf_f64(x) - exact).abs() / exact;
        assert!(error < tolerance, "erf({x}): {error:e}");
        assert_eq!(erf_f64(-x), -erf_f64(x));
    }
    assert_eq!((erf_f64(0.0), erf_f64(f64::INFINITY), erf_f64(f64::NEG_INFINITY)), (0.0, 1.0, -1.0));
    assert!(erf_f64(f64::NAN).is_nan());
}

/// A generic expression, so that the methods are those of [`Real`].
#[inline(always)]
fn wavy<T: Real>(x: T) -> T {
    x.exp() + x.tanh() * x.erf()
}

#[test]
fn dispatch_changes_no_bits() {
    let x: Vec<f32> = (0..1000).map(|i| i as f32 * 0.01 - 5.0).collect();
    let mut y = x.clone();
    simd::dispatch(
        #[inline(always)]
        || y.iter_mut().for_each(|y| *y = wavy(*y)),
    );
    for (x, y) in x.iter().zip(&y) {
        assert_eq!(*y, wavy(*x));
    }
    assert!(simd::level() <= simd::Level::Avx512);
}
