//! Weights that are kept.

use crate::scene::Scene;
use proptest::prelude::*;
use std::sync::Arc;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_kernels::Real;
use weaver_splat::{BlendWeights, Target, Workspace};

fn weights<T: Real>(scene: &Scene<T>) -> (Arc<BlendWeights<T>>, Workspace<T>) {
    let mut workspace = Workspace::new();
    scene.render_in(&mut workspace);
    (Arc::new(BlendWeights::of(&workspace).unwrap()), workspace)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 8, failure_persistence: None, ..Default::default() })]

    /// Pictures and gradients of features equal the rasterizer's, in groups or not.
    ///
    /// Promise (results): weights of a drawing, kept: products are drawings, also gradients and on any number of
    /// threads; a router trained by them is the one that draws.
    #[test]
    fn products_are_drawings(
        seed: u64, n in 0_usize..300, channels in 1_usize..7, groups in prop::option::of(1_usize..4),
    ) {
        let mut scene = Scene::random(seed, n, 2, (33, 21), None).with_channels(channels);
        if let Some(count) = groups {
            scene = scene.in_groups(count);
        }
        let (drawn, cotangent) = (scene.render(), scene.cotangents(seed).features);
        let (weights, mut workspace) = weights(&scene);
        prop_assert_eq!([weights.pixels(), weights.gaussians()], [drawn.alpha.len(), n]);
        let tape = Tape::new();
        let features = tape.leaf(&scene.features, [n, channels]);
        let blended = weights.blend(features);
        (blended * tape.constant(&cotangent, blended.shape())).sum().backward();
        let mut expected = vec![0.0; n * channels];
        workspace.feature_gradients(&cotangent, channels, Target::write(&mut expected)).unwrap();
        let close = |a: &[f64], b: &[f64]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12 * (1.0 + b.abs()));
        prop_assert!(close(&blended.to_vec(), &drawn.features));
        prop_assert!(close(features.grad().as_deref().unwrap_or_default(), &expected));
        for (pixel, alpha) in drawn.alpha.iter().enumerate() {
            let sum: f64 = weights.of_pixel(pixel).map(|(_, weight)| weight).sum();
            prop_assert!((sum - alpha).abs() < 1e-12);
        }
    }

    #[test]
    fn blending_passes_gradcheck(seed: u64, n in 1_usize..6, channels in 1_usize..4) {
        let (weights, _) = weights(&Scene::random(seed, n, 1, (5, 4), None));
        gradcheck(&[Input::uniform(seed, -1.0, 1.0, [n, channels])], |x| vec![weights.blend(x[0])]);
    }
}

/// Parts and their order are the sizes', not the threads'.
///
/// Promise of `products_are_drawings`.
#[test]
fn the_same_bits_on_any_number_of_threads() {
    let scene = Scene::random(3, 60, 2, (64, 48), None).to_f32();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let (weights, _) = weights(&scene);
            let tape = Tape::new();
            let features = tape.leaf(&scene.colors, [60, 3]);
            let blended = weights.blend(features);
            (blended * blended).sum().backward();
            (weights, features.grad().unwrap().to_vec())
        })
    };
    let (weights, gradient) = run(1);
    assert!(weights.bytes() > 4 * 60 * 64, "pixels show some of them");
    for threads in [2, 3, 8] {
        let other = run(threads);
        assert_eq!((&*other.0, other.1), (&*weights, gradient.clone()));
    }
}

#[test]
fn nothing_drawn_is_nothing_to_keep() {
    let error = BlendWeights::of(&Workspace::<f32>::new()).unwrap_err().to_string();
    assert!(error.contains("nothing was drawn"), "{error}");
}
