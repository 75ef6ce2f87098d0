use crate::strategies::{distance, unit, vector};
use proptest::prelude::*;
use std::f64::consts::PI;
use weaver_geometry::glam::DMat3;
use weaver_geometry::{se3, so3};

/// The series of the matrix exponential.
fn series(a: DMat3) -> DMat3 {
    let (mut sum, mut term) = (DMat3::IDENTITY, DMat3::IDENTITY);
    for n in 1..60 {
        term = term * a * (1.0 / f64::from(n));
        sum += term;
    }
    sum
}

/// Angles where formulas break: tiny, where series take over, ordinary, and up to half a turn.
fn angle() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(0.0),
        (-300.0..-1.0f64).prop_map(|e| 10f64.powf(e)),
        1e-4..0.2f64,
        0.2..3.0f64,
        (1e-12..0.1f64).prop_map(|d| PI - d),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

    #[test]
    fn rotation_round_trip(axis in unit(), angle in angle()) {
        let omega = axis * angle;
        let rotation = so3::exp(omega);
        prop_assert!(distance(&rotation, &series(so3::hat(omega))) < 1e-13);
        let back = so3::log(&rotation);
        prop_assert!((back - omega).length() < 1e-14 + 1e-13 * angle, "{omega} {back}");
    }

    #[test]
    fn rigid_round_trip(axis in unit(), angle in angle(), v in vector(3.0)) {
        let omega = axis * angle;
        let pose = se3::exp(v, omega);
        // The translation is the integral of exp(s omega) v over s from 0 to 1, here term by term.
        let (mut sum, mut term) = (v, v);
        for n in 1..60 {
            term = so3::hat(omega) * term / f64::from(n + 1);
            sum += term;
        }
        prop_assert!((pose.translation - sum).length() < 1e-12);
        let (v_back, omega_back) = se3::log(&pose);
        prop_assert!((v_back - v).length() < 1e-12 && (omega_back - omega).length() < 1e-12, "{v} {v_back}");
    }

    #[test]
    fn half_turns(axis in unit()) {
        // At pi the axis is determined up to its sign.
        let back = so3::log(&so3::exp(axis * PI));
        prop_assert!((back - axis * PI).length().min((back + axis * PI).length()) < 1e-12);
    }

    #[test]
    fn hat_is_the_cross_product(a in vector(2.0), b in vector(2.0)) {
        prop_assert!((so3::hat(a) * b - a.cross(b)).length() < 1e-14);
    }
}
