use crate::strategies::{rotation, unit};
use proptest::prelude::*;
use std::f64::consts::TAU;
use weaver_geometry::glam::DVec3;
use weaver_geometry::sh::{self, MAX_COEFFICIENTS, MAX_DEGREE, coefficients, gradient};

fn basis(direction: [f64; 3]) -> [f64; MAX_COEFFICIENTS] {
    sh::basis(MAX_DEGREE, direction, |x| x)
}

/// Nodes and weights of the 5-point Gauss-Legendre rule, exact up to degree 9 (products here reach 8).
const LEGENDRE: [(f64, f64); 5] = [
    (0.0, 0.5688888888888889),
    (0.5384693101056831, 0.47862867049936647),
    (-0.5384693101056831, 0.47862867049936647),
    (0.906179845938664, 0.23692688505618908),
    (-0.906179845938664, 0.23692688505618908),
];

#[test]
fn orthonormal_over_the_sphere() {
    let mut gram = [[0.0; MAX_COEFFICIENTS]; MAX_COEFFICIENTS];
    for (z, weight) in LEGENDRE {
        for i in 0..16 {
            let phi = TAU * f64::from(i) / 16.0;
            let r = (1.0 - z * z).sqrt();
            let values = basis([r * phi.cos(), r * phi.sin(), z]);
            for a in 0..MAX_COEFFICIENTS {
                for b in 0..MAX_COEFFICIENTS {
                    gram[a][b] += values[a] * values[b] * weight * TAU / 16.0;
                }
            }
        }
    }
    for (a, row) in gram.iter().enumerate() {
        for (b, value) in row.iter().enumerate() {
            assert!((value - f64::from(a == b)).abs() < 1e-12, "{a} {b}: {value}");
        }
    }
}

#[test]
fn signs_of_the_reference() {
    // At a direction where no factor vanishes; worked out by hand from the polynomials of the reference's shader.
    let values = basis(DVec3::new(1.0, 0.5, 0.9).normalize().to_array());
    let signs: String = values.iter().map(|v| if *v < 0.0 { '-' } else { '+' }).collect();
    assert_eq!(signs, "+-+-+-+-+-+---+-+-++-++--");
    assert_eq!([0, 1, 2, 3, 4].map(coefficients), [1, 4, 9, 16, 25]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 16))]

    #[test]
    fn gradient_is_the_slope_along_the_sphere(direction in unit(), toward in unit()) {
        let tangent = toward - direction * toward.dot(direction);
        let h = 1e-6;
        let at = |s: f64| basis((direction + tangent * s).normalize().to_array());
        let (before, after) = (at(-h), at(h));
        for (i, row) in gradient(direction.to_array()).into_iter().enumerate() {
            let slope = DVec3::from_array(row).dot(tangent);
            let numeric = (after[i] - before[i]) / (2.0 * h);
            prop_assert!((slope - numeric).abs() < 1e-7, "{i}: {slope} {numeric}");
            prop_assert!(DVec3::from_array(row).dot(direction).abs() < 1e-12);
        }
    }

    #[test]
    fn single_precision_agrees(direction in unit()) {
        let single = sh::basis(MAX_DEGREE, direction.to_array().map(|x| x as f32), |x| x as f32);
        for (a, b) in basis(direction.to_array()).iter().zip(single) {
            prop_assert!((a - f64::from(b)).abs() < 3e-6);
        }
    }

    #[test]
    fn a_lower_degree_is_the_beginning_of_a_higher_one(direction in unit(), degree in 0..=MAX_DEGREE) {
        let (all, some) = (basis(direction.to_array()), sh::basis(degree, direction.to_array(), |x| x));
        let k = coefficients(degree);
        prop_assert_eq!(&all[..k], &some[..k]);
        prop_assert!(some[k..].iter().all(|x: &f64| *x == 0.0));
    }

    /// Rotated coefficients give the color along the rotated direction.
    #[test]
    fn coefficients_rotate_with_directions(
        turn in rotation(),
        direction in unit(),
        c in prop::collection::vec(-1.0..1.0f64, MAX_COEFFICIENTS),
    ) {
        let (before, after) = (basis(direction.to_array()), basis((turn * direction).to_array()));
        for (matrix, l) in sh::rotation(MAX_DEGREE, &turn).iter().zip(1..) {
            let (first, n) = (coefficients(l - 1), 2 * l + 1);
            let rotated = matrix.chunks_exact(n).map(|row| row.iter().zip(&c[first..]).map(|(m, c)| m * c).sum::<f64>());
            let color: f64 = rotated.zip(&after[first..]).map(|(c, b)| c * b).sum();
            let expected: f64 = (first..first + n).map(|i| before[i] * c[i]).sum();
            prop_assert!((color - expected).abs() < 1e-10, "degree {l}: {color} {expected}");
        }
    }
}
