//! The fast rasterizer against the slow reference.

use crate::scene::{NAMES, Planes, Scene, flatten, relative};
use proptest::prelude::*;
use weaver_splat::{RasterSettings, Region, TileSide, reference};

pub fn reference_gradients(scene: &Scene<f64>, cotangents: &Planes<f64>) -> [Vec<f64>; 10] {
    let cotangents = cotangents.as_cotangents();
    let d = reference::rasterize_backward(&scene.gaussians(), &scene.cameras(), &scene.settings, &cotangents).unwrap();
    let (features, statistics) = (d.features, flatten(&d.statistics));
    [d.means, d.quats, d.scales, d.opacities, d.colors, d.viewmats, d.intrinsics, d.background, features, statistics]
}

pub fn reference_planes(scene: &Scene<f64>) -> Planes<f64> {
    let r = reference::rasterize(&scene.gaussians(), &scene.cameras(), &scene.settings).unwrap();
    Planes { image: r.image, alpha: r.alpha, depth: r.depth, features: r.features }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 8, failure_persistence: None, ..Default::default() })]

    #[test]
    fn agrees_with_the_reference(
        seed: u64,
        n in 0_usize..60,
        views in 1_usize..4,
        size in (1_usize..40, 1_usize..40),
        degree in prop::option::of(0_usize..=4),
        antialiased: bool,
        tile in prop::sample::select(vec![TileSide::Sixteen, TileSide::ThirtyTwo, TileSide::SixtyFour]),
        alpha_max in prop::sample::select(vec![0.99, 0.999]),
        thin: bool,
        channels in prop::sample::select(vec![0_usize, 1, 2, 5, 17]),
        colorless: bool,
        region in prop::option::of(any::<(prop::sample::Index, prop::sample::Index)>()),
        groups in prop::option::of(1_usize..4),
    ) {
        let mut scene = Scene::random(seed, n, views, size, degree).with_channels(channels);
        if colorless {
            scene = scene.without_colors();
        }
        if let Some(count) = groups {
            scene = scene.in_groups(count);
        }
        scene.settings = RasterSettings { antialiased, tile, alpha_max, ..RasterSettings::default() };
        if let Some((x, y)) = region {
            let (x, y) = (x.index(size.0), y.index(size.1));
            scene.settings.region = Some(Region { x, y, width: size.0 - x, height: size.1 - y });
        }
        if thin {
            scene.scales.iter_mut().step_by(3).for_each(|s| *s *= 1e-3);
        }
        prop_assert!(relative(&scene.render().flat(), &reference_planes(&scene).flat(), 1e-3) < 1e-11);
        let cotangents = scene.cotangents(seed);
        let expected = reference_gradients(&scene, &cotangents);
        for ((name, fast), slow) in NAMES.iter().zip(&scene.gradients(&cotangents)).zip(&expected) {
            let error = relative(fast, slow, 1e-3);
            prop_assert!(error < 1e-9, "{name}: {error}");
        }
    }
}
