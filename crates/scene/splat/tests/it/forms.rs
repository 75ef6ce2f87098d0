//! Blending has a form for each choice of outputs: with depth or without, with features and statistics or without.

use crate::scene::{NAMES, Scene};
use proptest::prelude::*;
use weaver_geometry::lens::Lens;
use weaver_scene::Model;
use weaver_splat::{
    Cotangents, GaussianStatistics, Gradients, Images, Target, Workspace, rasterize, rasterize_backward,
};

/// Image and alpha of a scene, and the gradients from their cotangents that every form has: all but those of features.
fn drawn(
    scene: &Scene<f32>,
    [image, alpha]: [&[f32]; 2],
    [depth, statistics]: [bool; 2],
) -> ([Vec<f32>; 2], Vec<Vec<f32>>) {
    let (pixels, n) = (scene.pixels(), scene.opacities.len());
    let mut images = [3, 1, 1, scene.channels].map(|channels| vec![f32::NAN; channels * pixels]);
    let zeros = images.each_ref().map(|values| vec![0.0; values.len()]);
    let mut workspace = Workspace::new();
    let (gaussians, cameras, settings) = (scene.gaussians(), scene.cameras(), &scene.settings);
    let [to_image, to_alpha, to_depth, to_features] = &mut images;
    let (to_depth, to_features) =
        (depth.then_some(&mut to_depth[..]), (scene.channels > 0).then_some(&mut to_features[..]));
    let to = Images { image: to_image, alpha: to_alpha, depth: to_depth, features: to_features };
    rasterize(&gaussians, &cameras, settings, &mut workspace, to).unwrap();
    let lens = scene.model != Model::Pinhole;
    let lengths = [3 * n, 4 * n, 3 * n, n, scene.colors.len(), scene.viewmats.len(), scene.intrinsics.len()];
    let mut out = lengths.map(|len| vec![f32::NAN; len]);
    let mut of_all = vec![GaussianStatistics::default(); n];
    let cotangents = Cotangents {
        image: Some(image),
        alpha: Some(alpha),
        depth: depth.then_some(&zeros[2][..]),
        features: (scene.channels > 0).then_some(&zeros[3][..]),
    };
    let [means, quats, scales, opacities, colors, viewmats, intrinsics] =
        out.each_mut().map(|values| Some(Target::write(&mut values[..])));
    let intrinsics = intrinsics.filter(|_| !lens);
    let statistics = statistics.then_some(&mut of_all[..]);
    let gradients =
        Gradients { means, quats, scales, opacities, colors, viewmats, intrinsics, statistics, ..Gradients::default() };
    rasterize_backward(&gaussians, &cameras, settings, &mut workspace, &cotangents, gradients).unwrap();
    let [image, alpha, ..] = images;
    ([image, alpha], out.into_iter().take(if lens { 6 } else { 7 }).collect())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 8, failure_persistence: None, ..Default::default() })]

    /// Images and gradients are the same bits whatever else a call asks for. So checks of the form with everything, the
    /// only one in double precision, hold for all.
    #[test]
    fn every_form_gives_the_same_bits(seed: u64, n in 1_usize..60, lens: bool) {
        let mut scene = Scene::random(seed, n, 2, (33, 21), Some(1));
        if lens {
            // Views through a lens share it.
            scene.intrinsics.copy_within(..4, 4);
            scene.model = Model::Lens(Lens::EQUIDISTANT);
        }
        let cotangents = scene.cotangents(seed).to_f32();
        let of = [&cotangents.image[..], &cotangents.alpha[..]];
        let full = scene.to_f32();
        let plain = scene.with_channels(0).to_f32();
        let expected = drawn(&full, of, [true, true]);
        prop_assert!(expected.1.iter().flatten().all(|x| x.is_finite()));
        for (scene, with) in [(&full, "with features"), (&plain, "without features")] {
            for others in [[true, false], [false, true], [false, false]] {
                let found = drawn(scene, of, others);
                prop_assert_eq!(&found.0, &expected.0, "{} {:?}", with, others);
                for ((name, found), expected) in NAMES.iter().zip(found.1).zip(&expected.1) {
                    prop_assert_eq!(&found, expected, "{} {} {:?}", name, with, others);
                }
            }
        }
    }
}
