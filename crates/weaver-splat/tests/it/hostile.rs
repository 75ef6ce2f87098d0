//! Numbers that nobody should pass, and shapes at the edge.

use crate::scene::{Planes, Scene};
use proptest::prelude::*;
use weaver_splat::{Cotangents, Gradients, Images, Workspace, rasterize, rasterize_backward};

const NASTY: [f32; 14] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    0.0,
    -0.0,
    1e-45,
    -1e-30,
    1e-20,
    1e10,
    -1e19,
    1e30,
    -1e30,
    f32::MAX,
    f32::MIN,
];

fn ones(scene: &Scene<f32>) -> Planes<f32> {
    let pixels = scene.pixels();
    let [image, alpha, depth, features] = [3, 1, 1, scene.channels].map(|channels| vec![1.0; channels * pixels]);
    Planes { image, alpha, depth, features }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nothing_panics(
        seed: u64,
        degree in prop::option::of(0_usize..=4),
        antialiased: bool,
        places in prop::collection::vec((0_usize..8, any::<prop::sample::Index>(), prop::sample::select(NASTY.to_vec())), 1..12),
    ) {
        let mut scene = Scene::random(seed, 12, 2, (21, 18), degree);
        scene.settings.antialiased = antialiased;
        for (part, index, value) in &places {
            let mut parts = scene.parts();
            let part = &mut parts[*part];
            let at = index.index(part.len());
            part[at] = f64::from(*value);
        }
        let single = scene.to_f32();
        single.render();
        single.gradients(&ones(&single));
        scene.render();
        scene.gradients(&scene.cotangents(seed));
    }

    /// Gaussians that are not finite change nothing, are counted, and have zero gradients.
    #[test]
    fn bad_gaussians_are_left_out(
        seed: u64,
        part in 0_usize..5,
        offset in any::<prop::sample::Index>(),
        bad in prop::sample::select(vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY]),
        zero_quaternion: bool,
    ) {
        let good = Scene::random(seed, 30, 2, (21, 18), Some(1));
        let mut scene = good.clone();
        scene.features.extend_from_within(..2);
        // A copy of the first Gaussian, spoiled, at the end.
        let lengths = [3, 4, 3, 1, 12];
        for (part, len) in lengths.into_iter().enumerate() {
            let copy = scene.parts()[part][..len].to_vec();
            scene.parts()[part].extend(copy);
        }
        if zero_quaternion {
            scene.quats[120..].fill(0.0);
        } else {
            let len = lengths[part];
            scene.parts()[part][30 * len + offset.index(len)] = f64::from(bad);
        }
        let (good, scene) = (good.to_f32(), scene.to_f32());
        let (planes, stats) = scene.render_in(&mut Workspace::new());
        prop_assert_eq!(&planes, &good.render());
        prop_assert_eq!(stats.rejected, 2);
        let cotangents = ones(&scene);
        let (with, without) = (scene.gradients(&cotangents), good.gradients(&cotangents));
        for (part, len) in lengths.into_iter().enumerate() {
            prop_assert_eq!(&with[part][..30 * len], &without[part][..]);
            prop_assert!(with[part][30 * len..].iter().all(|&x| x == 0.0));
        }
        prop_assert_eq!(&with[5], &without[5]);
    }
}

#[test]
fn nothing_to_draw_is_background() {
    let mut scene = Scene::random(0, 0, 2, (1, 1), Some(3)).to_f32();
    scene.background = vec![0.25, 0.5, 0.75];
    let planes = scene.render();
    assert_eq!(planes.image, [0.25, 0.5, 0.75, 0.25, 0.5, 0.75]);
    assert_eq!((planes.alpha, planes.depth), (vec![0.0; 2], vec![0.0; 2]));
    assert_eq!(scene.gradients(&ones(&scene))[7], [2.0; 3]);
}

#[test]
fn misfits_are_errors() {
    let scene = Scene::random(0, 3, 1, (4, 4), None);
    let mut workspace = Workspace::new();
    let mut render = |scene: &Scene<f64>, pixels: usize| {
        let (mut image, mut alpha, mut depth) = (vec![0.0; 3 * pixels], vec![0.0; pixels], vec![0.0; pixels]);
        let mut features = vec![0.0; 2 * pixels];
        let images =
            Images { image: &mut image, alpha: &mut alpha, depth: Some(&mut depth), features: Some(&mut features) };
        rasterize(&scene.gaussians(), &scene.cameras(), &scene.settings, &mut workspace, images)
            .map_err(|error| error.to_string())
    };
    assert!(render(&scene, 15).unwrap_err().contains("image has 45 numbers, expected 48"));
    let mut short = scene.clone();
    short.quats.pop();
    assert!(render(&short, 16).unwrap_err().contains("quats has 11 numbers, expected 12"));
    let mut high = scene.clone();
    high.degree = Some(5);
    assert!(render(&high, 16).unwrap_err().contains("degree 5"));
    let mut flat = scene.clone();
    flat.height = 0;
    assert!(render(&flat, 0).unwrap_err().contains("4 x 0"));
    // The last forward failed, so there is nothing to go back from.
    let none = Cotangents::default();
    let error = rasterize_backward(
        &scene.gaussians(),
        &scene.cameras(),
        &scene.settings,
        &mut workspace,
        &none,
        Gradients::default(),
    );
    assert!(error.unwrap_err().to_string().contains("workspace of a forward"));
}
