//! exp, tanh and erf against `f64` and against series.

use crate::stressed;
use crate::twofold::{self, Twofold};
use weaver_kernels::Real;
use weaver_kernels::erf::{erf_f32, erf_f64};
use weaver_kernels::exp::{exp_f32, exp2_f32, tanh_f32};
use weaver_kernels::random::Stream;
use weaver_kernels::simd;

/// Distance from the exact value in units of the last place of `f32`.
fn ulps(got: f32, exact: f64) -> f64 {
    let e = exact as f32;
    if e.is_infinite() {
        return if got == e { 0.0 } else { f64::INFINITY };
    }
    let spacing = f64::from(f32::from_bits(e.abs().to_bits() + 1)) - f64::from(e.abs());
    (f64::from(got) - exact).abs() / spacing
}

/// The larger error; a NaN is the largest.
fn larger(a: f64, b: f64) -> f64 {
    if b.is_nan() { f64::INFINITY } else { a.max(b) }
}

/// Every so many-th float from 0 to infinity, and its negative: the whole range.
fn floats() -> impl Iterator<Item = f32> {
    let stride = if stressed() { 257 } else { 8209 };
    (0..f32::INFINITY.to_bits()).step_by(stride).flat_map(|b| [f32::from_bits(b), -f32::from_bits(b)])
}

fn worst(f: impl Fn(f32) -> f32, exact: impl Fn(f64) -> f64) -> f64 {
    floats().map(|x| ulps(f(x), exact(f64::from(x)))).fold(0.0, larger)
}

#[test]
fn exp_is_accurate() {
    let error = worst(exp_f32, f64::exp);
    assert!(error < 1.1, "{error} ulp");
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
fn exp2_is_accurate() {
    let normal = floats().filter(|x| *x >= -126.0);
    let error = normal.map(|x| ulps(exp2_f32(x), f64::from(x).exp2())).fold(0.0, larger);
    assert!(error < 2.5, "{error} ulp");
    for (x, y) in [(0.0, 1.0), (f32::INFINITY, f32::INFINITY), (f32::NEG_INFINITY, 0.0), (200.0, f32::INFINITY)] {
        assert_eq!(exp2_f32(x), y, "2^{x}");
    }
    assert!(exp2_f32(f32::NAN).is_nan());
    for x in [-127.5_f32, -140.0, -149.0, -151.0] {
        assert!((f64::from(exp2_f32(x)) - f64::from(x).exp2()).abs() < 1.5e-45, "2^{x}");
    }
}

#[test]
fn tanh_is_accurate() {
    let error = worst(tanh_f32, f64::tanh);
    assert!(error < 1.3, "{error} ulp");
    assert_eq!([tanh_f32(0.0), tanh_f32(-0.0)].map(f32::to_bits), [0.0_f32, -0.0].map(f32::to_bits));
    assert_eq!((tanh_f32(f32::INFINITY), tanh_f32(f32::NEG_INFINITY)), (1.0, -1.0));
    assert!(tanh_f32(f32::NAN).is_nan());
}

#[test]
fn erf_f32_is_accurate() {
    let error = worst(erf_f32, erf_f64);
    assert!(error < 1.5, "{error} ulp");
    assert_eq!([erf_f32(0.0), erf_f32(-0.0)].map(f32::to_bits), [0.0_f32, -0.0].map(f32::to_bits));
    assert_eq!((erf_f32(f32::INFINITY), erf_f32(f32::NEG_INFINITY)), (1.0, -1.0));
    assert!(erf_f32(f32::NAN).is_nan());
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

/// Distance from the exact value in units of the last place of `f64`.
fn ulps_f64(got: f64, exact: Twofold) -> f64 {
    let e = exact.0 + exact.1;
    if !e.is_finite() || got == e {
        return if got == e { 0.0 } else { f64::INFINITY };
    }
    let spacing = f64::from_bits(e.abs().to_bits() + 1) - e.abs();
    ((got - exact.0) - exact.1).abs() / spacing
}

/// Random bits with the exponents from 2^low to 2^high, both signs.
fn doubles(low: i32, high: i32) -> impl Iterator<Item = f64> {
    let stream = Stream::new(0, 0, "special.doubles");
    (0..if stressed() { 600_000 } else { 6000 }).map(move |i| {
        let exponent = (1023 + low + stream.below(2 * i, (high - low) as usize) as i32) as u64;
        f64::from_bits(exponent << 52 | stream.bits(2 * i + 1) & (1 << 63 | ((1 << 52) - 1)))
    })
}

fn worst_f64(f: impl Fn(f64) -> f64, exact: impl Fn(f64) -> Twofold, xs: impl Iterator<Item = f64>) -> f64 {
    xs.map(|x| ulps_f64(f(x), exact(x))).fold(0.0, larger)
}

/// In `f64` exp and tanh are the platform's.
#[test]
fn f64_is_within_two_ulp_over_the_whole_range() {
    let exp = worst_f64(Real::exp, twofold::exp, doubles(-60, 10).filter(|x| x.abs() < 708.0));
    let tanh = worst_f64(Real::tanh, twofold::tanh, doubles(-60, 6));
    let erf = worst_f64(erf_f64, twofold::erf, doubles(-60, 4));
    let tiny = worst_f64(erf_f64, twofold::erf, doubles(-1000, -60));
    assert!(exp < 1.0 && tanh < 2.0 && erf < 1.5 && tiny < 1.5, "{exp} {tanh} {erf} {tiny} ulp");
    assert_eq!((erf_f64(0.0), erf_f64(f64::INFINITY), erf_f64(f64::NEG_INFINITY)), (0.0, 1.0, -1.0));
    assert!(erf_f64(f64::NAN).is_nan() && erf_f64(f64::MAX) == 1.0);
}

/// A generic expression, so that the methods of [`Real`] are called.
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
