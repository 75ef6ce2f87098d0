//! Gradients against central differences of the loss <cotangent, output>, of the fast code and of the reference.

use crate::scene::{NAMES, Planes, Scene};
use crate::twin::reference_gradients;
use proptest::prelude::*;

fn loss(scene: &Scene<f64>, cotangents: &Planes<f64>) -> f64 {
    scene.render().flat().iter().zip(cotangents.flat()).map(|(a, b)| a * b).sum()
}

/// Checks every coordinate of every input.
fn check(scene: &Scene<f64>, cotangents: &Planes<f64>, gradients: &[Vec<f64>; 10]) {
    let scale: f64 = cotangents.flat().iter().map(|x| x.abs()).sum();
    for (part, gradients) in gradients.iter().enumerate().take(9) {
        assert_eq!(gradients.len(), scene.clone().parts()[part].len());
        for (at, &gradient) in gradients.iter().enumerate() {
            let slope = |step: f64| {
                let moved = |by: f64| {
                    let mut moved = scene.clone();
                    moved.parts()[part][at] += by;
                    loss(&moved, cotangents)
                };
                // Fourth order, so that the step can be large enough for the rounding.
                (8.0 * (moved(step) - moved(-step)) - (moved(2.0 * step) - moved(-2.0 * step))) / (12.0 * step)
            };
            let close = |slope: f64| (slope - gradient).abs() <= 1e-6 * gradient.abs() + 1e-9 * scale;
            // A long step may cross a branch that a short one does not.
            assert!(
                close(slope(1e-5)) || close(slope(1e-6)) || close(slope(1e-7)),
                "{}[{at}]: gradient {gradient}, central differences {} {} {}",
                NAMES[part],
                slope(1e-5),
                slope(1e-6),
                slope(1e-7)
            );
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 16, failure_persistence: None, ..Default::default() })]

    /// Splats that cover the whole image with alphas between the thresholds: smooth everywhere.
    #[test]
    fn agrees_with_central_differences(
        seed: u64,
        n in 1_usize..5,
        views in 1_usize..3,
        size in (1_usize..5, 1_usize..5),
        degree in prop::option::of(0_usize..=4),
        antialiased: bool,
        channels in prop::sample::select(vec![0_usize, 1, 5]),
        colorless: bool,
    ) {
        let mut scene = Scene::smooth(seed, n, views, size, degree).with_channels(channels);
        if colorless {
            scene = scene.without_colors();
        }
        scene.settings.antialiased = antialiased;
        let cotangents = scene.cotangents(seed);
        check(&scene, &cotangents, &scene.gradients(&cotangents));
    }
}

/// A scene with every branch in it: clipped by tiles, beyond the limits of the Jacobian, behind, opaque, faint,
/// floored.
#[test]
fn agrees_with_central_differences_in_a_crowd() {
    for (seed, antialiased) in [(3, false), (4, true)] {
        let mut scene = Scene::random(seed, 14, 2, (19, 17), Some(2));
        scene.settings.antialiased = antialiased;
        scene.opacities[0] = 0.999;
        scene.opacities[1] = 3.0;
        scene.scales[3..6].fill(1.0);
        scene.means[5] = 1.5;
        scene.scales[6..9].fill(1e-4);
        let cotangents = scene.cotangents(seed);
        check(&scene, &cotangents, &scene.gradients(&cotangents));
        check(&scene, &cotangents, &reference_gradients(&scene, &cotangents));
    }
}
