use crate::strategies::{distance, pose, rotation, vector};
use proptest::prelude::*;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Pose, Similarity, so3};

fn similarity() -> impl Strategy<Value = Similarity> {
    (0.1..10.0f64, rotation(), vector(5.0)).prop_map(|(scale, rotation, translation)| Similarity {
        scale,
        rotation,
        translation,
    })
}

fn cost(s: &Similarity, from: &[DVec3], to: &[DVec3]) -> f64 {
    from.iter().zip(to).map(|(f, t)| (s.apply(*f) - *t).length_squared()).sum()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 10))]

    #[test]
    fn recovers_the_transform(truth in similarity(), poses in proptest::collection::vec(pose(), 4..9)) {
        let moved: Vec<_> = poses.iter().map(|p| truth.apply_to_pose(p)).collect();
        let found = Similarity::fit_poses(&poses, &moved).unwrap();
        prop_assert!((found.scale / truth.scale - 1.0).abs() < 1e-9);
        prop_assert!(distance(&found.rotation, &truth.rotation) < 1e-8);
        prop_assert!((found.translation - truth.translation).length() < 1e-7);
        for (p, q) in poses.iter().zip(&moved) {
            // A camera sees a carried-over point where it saw the point, scaled.
            let x = DVec3::new(0.3, -2.0, 1.0);
            prop_assert!((p.apply(x) * truth.scale - q.apply(truth.apply(x))).length() < 1e-10);
        }
    }

    #[test]
    fn no_neighbor_fits_better(
        from in proptest::collection::vec(vector(2.0), 5..8), noise in proptest::collection::vec(vector(2.0), 8),
        turn in vector(0.01), shift in vector(0.01), factor in 0.99..1.01f64,
    ) {
        // Noise as large as the data, so that a reflection would often fit better than any rotation.
        let to: Vec<DVec3> = from.iter().zip(&noise).map(|(f, n)| *f * 0.5 + *n).collect();
        let best = Similarity::fit(&from, &to).unwrap();
        prop_assert!((best.rotation.determinant() - 1.0).abs() < 1e-12);
        let near = Similarity {
            scale: best.scale * factor,
            rotation: so3::exp(turn) * best.rotation,
            translation: best.translation + shift,
        };
        prop_assert!(cost(&best, &from, &to) <= cost(&near, &from, &to) + 1e-12);
    }
}

#[test]
fn undetermined_fits_are_none() {
    let line: Vec<DVec3> = (0..5).map(|i| DVec3::new(1.0, 2.0, -1.0) * f64::from(i)).collect();
    assert_eq!(Similarity::fit(&line, &line), None);
    assert_eq!(Similarity::fit(&[DVec3::ONE; 4], &[DVec3::ONE; 4]), None);
    assert_eq!(Similarity::fit(&line[..2], &line[..2]), None);
    let nan = [DVec3::X, DVec3::Y, DVec3::NAN];
    assert_eq!(Similarity::fit(&nan, &nan), None);
}

#[test]
fn two_cameras_determine_a_similarity() {
    let poses = [DVec3::ZERO, DVec3::X].map(|center| Pose::new(so3::exp(center), -(so3::exp(center) * center)));
    let truth = Similarity { scale: 2.5, rotation: so3::exp(DVec3::new(0.4, -1.0, 2.0)), translation: DVec3::Y };
    let moved = poses.map(|pose| truth.apply_to_pose(&pose));
    let found = Similarity::fit_poses(&poses, &moved).unwrap();
    assert!((found.scale - 2.5).abs() < 1e-12 && distance(&found.rotation, &truth.rotation) < 1e-12);
    assert_eq!(Similarity::fit_poses(&poses[..1], &moved[..1]), None);
    assert_eq!(Similarity::fit_poses(&[], &[]), None);
}

/// A planted scale and shift is found and is the least of its cost.
#[test]
fn a_planted_scale_and_shift_is_found() {
    let point = |i: usize| DVec3::new((1.3 * i as f64).sin(), (0.7 * i as f64).cos(), (2.1 * i as f64).sin());
    let from: Vec<DVec3> = (0..40).map(point).collect();
    let weights: Vec<f64> = (0..40).map(|i| 0.1 + (i % 5) as f64).collect();
    let shift = DVec3::new(0.3, -0.2, 5.0);
    let exact: Vec<DVec3> = from.iter().map(|x| *x * 1.7 + shift).collect();
    let found = Similarity::fit_scale_and_shift(&from, &exact, &weights, 0.0).unwrap();
    assert!((found.scale - 1.7).abs() < 1e-5 && (found.translation - shift).length() < 1e-5, "{found:?}");

    // With noise and ridge: no neighbor costs less.
    let noisy: Vec<DVec3> = exact.iter().enumerate().map(|(i, x)| *x + point(7 * i + 3) * 0.2).collect();
    let cost = |scale: f64, shift: DVec3| {
        let errors = from.iter().zip(&noisy).zip(&weights);
        let sum: f64 = errors.map(|((from, to), w)| w * (*from * scale + shift - *to).length_squared()).sum();
        sum + 0.5 * (scale * scale + shift.length_squared())
    };
    let found = Similarity::fit_scale_and_shift(&from, &noisy, &weights, 0.5).unwrap();
    let least = cost(found.scale, found.translation);
    for (by, to) in [(1e-4, DVec3::ZERO), (0.0, DVec3::X * 1e-4), (0.0, DVec3::Y * 1e-4), (0.0, DVec3::Z * 1e-4)] {
        assert!(cost(found.scale + by, found.translation + to) > least);
        assert!(cost(found.scale - by, found.translation - to) > least);
    }

    // One point, no weight or no number leaves it undetermined.
    let one = [DVec3::X];
    assert_eq!(Similarity::fit_scale_and_shift(&one, &one, &[1.0], 0.0), None);
    assert_eq!(Similarity::fit_scale_and_shift(&from, &exact, &[0.0; 40], 0.0), None);
    assert_eq!(Similarity::fit_scale_and_shift(&from, &exact, &[f64::NAN; 40], 1e-6), None);
}
