//! Stored form, activated form, slices.

use proptest::prelude::*;
use weaver_geometry::Similarity;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_scene::{Color, Gaussians};

fn gaussians() -> impl Strategy<Value = Gaussians> {
    (0usize..5, 0usize..=4).prop_flat_map(|(n, degree)| {
        let number = -10.0f32..10.0;
        (
            prop::collection::vec(prop::array::uniform3(number.clone()), n),
            prop::collection::vec(prop::array::uniform3(number.clone()), n),
            prop::collection::vec(prop::array::uniform4(number.clone()), n),
            prop::collection::vec(number.clone(), n),
            prop::collection::vec(number, n * 3 * (degree + 1).pow(2)),
        )
            .prop_map(move |(means, log_scales, quats, opacity_logits, sh)| Gaussians {
                means,
                log_scales,
                quats,
                opacity_logits,
                sh,
                degree,
            })
    })
}

proptest! {
    #[test]
    fn stored_activated_stored(stored in gaussians()) {
        prop_assert!(stored.lengths_agree());
        let activated = stored.to_activated();
        let back = activated.to_stored();
        prop_assert_eq!((activated.len(), activated.is_empty()), (stored.len(), stored.is_empty()));
        prop_assert_eq!((&back.means, &back.quats, &back.sh, back.degree), (&stored.means, &stored.quats, &stored.sh, stored.degree));
        for (a, b) in back.log_scales.as_flattened().iter().zip(stored.log_scales.as_flattened()) {
            prop_assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
        for (a, b) in back.opacity_logits.iter().zip(&stored.opacity_logits) {
            // An opacity near 1 has few digits left of its distance to 1.
            prop_assert!((a - b).abs() < 1e-6 * (1.0 + b.exp()) + 1e-5, "{a} {b}");
        }
    }

    #[test]
    fn there_and_back_into_another_world(
        stored in gaussians(),
        axis in prop::array::uniform3(-1.0f64..1.0),
        angle in 0.0f64..3.0,
        shift in prop::array::uniform3(-5.0f64..5.0),
        scale in 0.1f64..10.0,
    ) {
        let axis = DVec3::from(axis).try_normalize().unwrap_or(DVec3::X);
        let rotation = DMat3::from_axis_angle(axis, angle);
        let there = Similarity { scale, rotation, translation: DVec3::from(shift) };
        let inverse = rotation.transpose();
        let back = Similarity { scale: 1.0 / scale, rotation: inverse, translation: inverse * there.translation * (-1.0 / scale) };
        let found = stored.transformed(&there).transformed(&back);
        let near = |a: &[f32], b: &[f32], within: f32| a.iter().zip(b).all(|(a, b)| (a - b).abs() < within);
        prop_assert!(near(found.means.as_flattened(), stored.means.as_flattened(), 1e-3));
        prop_assert!(near(found.log_scales.as_flattened(), stored.log_scales.as_flattened(), 1e-4));
        prop_assert!(near(&found.sh, &stored.sh, 1e-3));
        prop_assert_eq!((&found.opacity_logits, found.degree), (&stored.opacity_logits, stored.degree));
        for (a, b) in found.quats.iter().zip(&stored.quats) {
            // Of any length, and the opposite one is the same rotation.
            let dot: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
            prop_assert!(near(&a.map(|a| a * dot.signum()), b, 1e-3), "{a:?} {b:?}");
        }
    }

    #[test]
    fn slices_hold_what_the_fields_hold(stored in gaussians()) {
        let activated = stored.to_activated();
        let slices = activated.as_slices();
        prop_assert_eq!(slices.means, stored.means.as_flattened());
        prop_assert_eq!(slices.quats, stored.quats.as_flattened());
        prop_assert_eq!(slices.opacities.len(), stored.len());
        prop_assert_eq!(slices.color.values(), (&stored.sh[..], 3 * stored.coefficients()));
    }
}

#[test]
fn extreme_opacities_and_scales_stay_finite() {
    let stored = Gaussians {
        means: vec![[0.0; 3]; 2],
        log_scales: vec![[-100.0; 3]; 2],
        quats: vec![[1.0, 0.0, 0.0, 0.0]; 2],
        opacity_logits: vec![f32::INFINITY, f32::NEG_INFINITY],
        sh: vec![0.0; 6],
        degree: 0,
    };
    let activated = stored.to_activated();
    assert_eq!(activated.opacities, [1.0, 0.0]);
    let back = activated.to_stored();
    assert!(back.opacity_logits.iter().chain(back.log_scales.as_flattened()).all(|x| x.is_finite()), "{back:?}");
}

#[test]
fn colors_know_how_many_numbers_a_gaussian_has() {
    assert_eq!(Color::<f32>::None.values(), (&[][..], 0));
    assert_eq!(Color::Plain(&[1.0, 2.0, 3.0]).values().1, 3);
    assert_eq!(Color::Sh { coefficients: &[0.0; 27], degree: 2 }.values().1, 27);
    let broken = Gaussians { means: vec![[0.0; 3]], ..Gaussians::default() };
    assert!(!broken.lengths_agree());
}
