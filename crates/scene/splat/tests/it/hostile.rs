//! Numbers that no caller should pass, and shapes at the edge: clean frames, finite gradients, or an error that says
//! why.

use crate::scene::{NAMES, Planes, Scene, relative};
use crate::twin::reference_planes;
use proptest::prelude::*;
use weaver_kernels::Real;
use weaver_scene::{CameraSlices, Color, GaussianSlices, Model};
use weaver_splat::{Cotangents, Gradients, Images, RasterSettings, Target, Workspace, rasterize, rasterize_backward};

/// In `f32` the last four are infinities.
const NASTY: [f64; 21] = [
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    0.0,
    -0.0,
    1e-45,
    -1e-40,
    -1e-30,
    1e-20,
    1e10,
    -1e19,
    1e30,
    -1e30,
    3.402_823_4e38,
    -3.402_823_4e38,
    5e-324,
    1e-300,
    1e300,
    -1e300,
    f64::MAX,
    f64::MIN,
];

fn ones<T: Real>(scene: &Scene<T>) -> Planes<T> {
    let pixels = scene.pixels();
    let channels = [scene.image_channels(), 1, 1, scene.channels];
    let [image, alpha, depth, features] = channels.map(|channels| vec![T::ONE; channels * pixels]);
    Planes { image, alpha, depth, features }
}

/// Renders and differentiates: every output is a number, for any input.
fn endure<T: Real>(scene: &Scene<T>, cotangents: &Planes<T>) -> Result<(), TestCaseError> {
    let mut workspace = Workspace::new();
    let (planes, stats) = scene.render_in(&mut workspace);
    prop_assert!(planes.flat().iter().all(|x| x.is_finite()), "{:?}", scene);
    prop_assert!(planes.alpha.iter().all(|&x| x >= T::ZERO && x <= T::ONE), "{:?}", scene);
    prop_assert!(stats.splats + stats.rejected <= scene.views() * scene.opacities.len());
    for (name, gradient) in NAMES.iter().zip(scene.gradients_in(cotangents, &mut workspace)) {
        prop_assert!(gradient.iter().all(|x| x.is_finite()), "{} {:?} of {:?}", name, gradient, scene);
    }
    Ok(())
}

fn nasty() -> impl Strategy<Value = f64> {
    prop::sample::select(NASTY.to_vec())
}

fn settings() -> impl Strategy<Value = RasterSettings> {
    let choices =
        (any::<bool>(), prop::sample::select(vec![0.01, 1e-10, 0.0, -1.0]), prop::sample::select(vec![0.3, 0.0]));
    choices.prop_map(|(antialiased, near, eps2d)| RasterSettings { antialiased, near, eps2d, ..Default::default() })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 2, failure_persistence: None, ..Default::default() })]

    /// A few numbers of anything but the background are nasty.
    #[test]
    fn numbers_anywhere(
        seed: u64,
        degree in prop::option::of(0_usize..=4),
        settings in settings(),
        places in prop::collection::vec((0_usize..9, any::<prop::sample::Index>(), nasty()), 1..12),
    ) {
        let mut scene = Scene::random(seed, 12, 2, (21, 18), degree);
        scene.settings = settings;
        for (part, index, value) in &places {
            let mut parts = scene.parts();
            let part = &mut parts[*part];
            let at = index.index(part.len());
            part[at] = *value;
        }
        scene.background.fill(0.5);
        let single = scene.to_f32();
        endure(&single, &ones(&single))?;
        endure(&scene, &scene.cotangents(seed))?;
    }

    /// Cotangents as large as they get.
    #[test]
    fn large_cotangents(seed: u64, degree in prop::option::of(0_usize..=4), places in prop::collection::vec((0_usize..4, any::<prop::sample::Index>()), 1..12)) {
        let scene = Scene::random(seed, 12, 2, (21, 18), degree).to_f32();
        let mut cotangents = ones(&scene);
        let planes = [&mut cotangents.image, &mut cotangents.alpha, &mut cotangents.depth, &mut cotangents.features];
        for (plane, index) in &places {
            let at = index.index(planes[*plane].len());
            planes[*plane][at..].fill(if at % 2 == 0 { f32::MAX } else { -f32::MAX });
        }
        endure(&scene, &cotangents)?;
    }

    /// Gaussians that are not finite change nothing, are counted, and have zero gradients.
    #[test]
    fn bad_gaussians_are_left_out(
        seed: u64,
        // Means, quaternions, scales, opacities, colors, features.
        part in prop::sample::select(vec![0_usize, 1, 2, 3, 4, 8]),
        offset in any::<prop::sample::Index>(),
        bad in prop::sample::select(vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY]),
        short_quaternion in prop::option::of(prop::sample::select(vec![0.0, -0.0, 1e-45, -1e-39])),
    ) {
        let good = Scene::random(seed, 30, 2, (21, 18), Some(1));
        let mut scene = good.clone();
        // A copy of a Gaussian that is seen, spoiled, at the end.
        let seen = good.gradients(&good.cotangents(seed))[3].iter().position(|&x| x != 0.0);
        prop_assume!(seen.is_some());
        let original = seen.unwrap();
        let lengths = [(0, 3), (1, 4), (2, 3), (3, 1), (4, 12), (8, 2)];
        for (part, len) in lengths {
            let copy = scene.parts()[part][original * len..][..len].to_vec();
            scene.parts()[part].extend(copy);
        }
        if let Some(value) = short_quaternion {
            scene.quats[120..].fill(value);
        } else {
            let len = lengths.iter().find(|(other, _)| *other == part).unwrap().1;
            scene.parts()[part][30 * len + offset.index(len)] = bad;
        }
        let (good, scene) = (good.to_f32(), scene.to_f32());
        let (planes, stats) = scene.render_in(&mut Workspace::new());
        prop_assert_eq!(&planes, &good.render());
        prop_assert!(stats.rejected == 1 || stats.rejected == 2, "in the views that see it: {}", stats.rejected);
        let (own, all_views) = (part == 4 || part == 8, short_quaternion.is_some());
        prop_assert!(stats.rejected == 2 || own && !all_views, "only colors and features are not looked at everywhere");
        let cotangents = ones(&scene);
        let (with, without) = (scene.gradients(&cotangents), good.gradients(&cotangents));
        for (part, len) in lengths {
            prop_assert_eq!(&with[part][..30 * len], &without[part][..]);
            prop_assert!(with[part][30 * len..].iter().all(|&x| x == 0.0));
        }
        for part in 5..8 {
            prop_assert_eq!(&with[part], &without[part]);
        }
        prop_assert_eq!(&with[9][..180], &without[9][..]);
        prop_assert_eq!(&with[9][180..], [0.0; 6]);
    }
}

/// Every nasty number in every number of a Gaussian, and in all of them together.
#[test]
fn each_number_in_each_place() {
    for degree in [None, Some(2)] {
        let base = Scene::random(5, 3, 1, (9, 7), degree);
        assert!(base.gradients(&ones(&base))[3][0] != 0.0, "the first one is seen");
        let lengths = [3, 4, 3, 1, base.colors.len() / 3];
        for (part, len) in lengths.into_iter().enumerate() {
            // One of them, or all.
            for (first, count) in (0..len).map(|i| (i, 1)).chain([(0, len)]) {
                for value in NASTY {
                    let mut scene = base.clone();
                    scene.parts()[part][first..first + count].fill(value);
                    let single = scene.to_f32();
                    endure(&single, &ones(&single)).unwrap();
                    endure(&scene, &ones(&scene)).unwrap();
                    let stats = single.render_in(&mut Workspace::new()).1;
                    if !(value as f32).is_finite() {
                        assert_eq!(stats.rejected, 1, "{part} {first} {count} {value}");
                    }
                }
            }
        }
    }
}

/// Gaussians at the camera, behind it, or at the near plane are not drawn or drawn by the rule, and never an accident.
#[test]
fn at_and_behind_the_camera() {
    for near in [0.01, 1e-10, 0.0] {
        for degree in [None, Some(3)] {
            for z in [0.0, -0.0, 1e-45, 1e-38, 1e-20, 1e-10, 0.009_999, 0.01, -1e-45, -1e-20, -0.01, -1.0] {
                let mut scene = Scene::random(8, 4, 1, (15, 11), degree);
                scene.viewmats = vec![1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
                scene.settings.near = near;
                scene.means[..3].copy_from_slice(&[0.0, 0.0, z]);
                scene.means[3..6].copy_from_slice(&[1e-3, -1e-3, z]);
                let single = scene.to_f32();
                endure(&single, &ones(&single)).unwrap();
                endure(&scene, &ones(&scene)).unwrap();
                let gradients = single.gradients(&ones(&single));
                if (z as f32) < near as f32 {
                    assert_eq!((&gradients[0][..6], &gradients[3][..2]), ([0.0; 6].as_slice(), [0.0; 2].as_slice()));
                }
            }
        }
    }
}

/// Broken colors, features and opacities of invisible Gaussians do no harm, and are not counted.
#[test]
fn what_is_not_seen_is_not_looked_at() {
    for degree in [None, Some(1)] {
        let good = Scene::random(3, 20, 1, (16, 12), degree);
        let mut scene = good.clone();
        scene.means[2] = -5.0;
        let hidden = scene.clone();
        let len = scene.colors.len() / 20;
        scene.colors[..len].fill(f64::NAN);
        scene.features[..2].fill(f64::INFINITY);
        let (planes, stats) = scene.render_in(&mut Workspace::new());
        assert_eq!((planes, stats.rejected), (hidden.render(), 0));
        scene.means[0] = f64::NAN;
        assert_eq!(scene.render_in(&mut Workspace::new()).1.rejected, 1);
    }
}

#[test]
fn opacities_from_nothing_to_one() {
    let mut scene = Scene::smooth(4, 1, 1, (7, 5), None);
    for opacity in [0.0, -0.0, 1e-45, 1e-6, 1.0 / 256.0] {
        scene.opacities[0] = opacity;
        let (planes, stats) = scene.render_in(&mut Workspace::new());
        assert_eq!((stats.splats, stats.rejected, stats.pairs), (0, 0, 0));
        assert!(planes.alpha.iter().all(|&x| x == 0.0));
        assert!(scene.gradients(&ones(&scene)).iter().take(7).flatten().all(|&x| x == 0.0));
    }
    for opacity in [1.0, 2.0, 1e30] {
        scene.opacities[0] = opacity;
        scene.scales.fill(100.0);
        let planes = scene.render();
        assert!(planes.alpha.iter().all(|&x| (x - 0.99).abs() < 1e-12));
        let gradients = scene.gradients(&ones(&scene));
        assert!(gradients[3] == [0.0] && gradients[4].iter().all(|x| x.is_finite() && *x != 0.0));
    }
}

/// One Gaussian over the whole of an image of many tiles, in `f32` too.
#[test]
fn one_gaussian_over_everything() {
    for size in [(1, 1), (16, 16), (63, 65), (129, 40)] {
        for scale in [3.0, 1e3, 1e6] {
            let mut scene = Scene::smooth(6, 1, 1, size, Some(1));
            scene.scales.fill(scale);
            let (planes, stats) = scene.to_f32().render_in(&mut Workspace::new());
            assert_eq!(stats.pairs, (size.0 * size.1) as u64);
            assert!(relative(&planes.flat(), &reference_planes(&scene).flat(), 0.0) < 1e-5);
            let single = scene.to_f32();
            endure(&single, &ones(&single)).unwrap();
        }
    }
}

/// A scale of zero, a needle, a disc: the blur alone gives them a size.
#[test]
fn zero_scales() {
    for antialiased in [false, true] {
        for scales in [[0.0; 3], [0.0, 0.0, 0.4], [0.4, 0.0, 0.4]] {
            let mut scene = Scene::random(2, 6, 1, (13, 9), None);
            scene.settings.antialiased = antialiased;
            scene.scales = scales.repeat(6);
            assert!(relative(&scene.render().flat(), &reference_planes(&scene).flat(), 1e-3) < 1e-11);
            let (single, ones) = (scene.to_f32(), ones(&scene.to_f32()));
            endure(&single, &ones).unwrap();
            // Without the blur there is nothing to draw, and no gradient.
            scene.scales.fill(0.0);
            scene.settings.eps2d = 0.0;
            let single = scene.to_f32();
            assert_eq!(single.render_in(&mut Workspace::new()).1.pairs, 0);
            endure(&single, &ones).unwrap();
        }
    }
}

/// A million Gaussians on one pixel: those in front fill it, the others get nothing; equal depths go by index.
#[test]
fn a_million_on_one_pixel() {
    const N: usize = 1_000_000;
    let flat = |row: &[f32]| row.repeat(N);
    for equal in [true, false] {
        // Not equal: the last is the nearest.
        let depth = |i: usize| if equal { 2.0 } else { 3.0 - i as f32 * 1e-6 };
        let means: Vec<f32> = (0..N).flat_map(|i| [0.0, 0.0, depth(i)]).collect();
        let (opacities, quats, scales, colors) =
            (flat(&[0.005]), flat(&[1.0, 0.0, 0.0, 0.0]), flat(&[0.1; 3]), flat(&[1.0, 0.5, 0.25]));
        let gaussians = GaussianSlices {
            means: &means,
            quats: &quats,
            scales: &scales,
            opacities: &opacities,
            color: Color::Plain(&colors),
            features: None,
            groups: None,
        };
        let cameras = CameraSlices {
            viewmats: &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            intrinsics: &[1.0, 1.0, 0.5, 0.5],
            background: &[0.0; 3],
            width: 1,
            height: 1,
            model: Model::Pinhole,
        };
        let (mut image, mut alpha) = ([0.0; 3], [0.0]);
        let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
        let (settings, mut workspace) = (RasterSettings::default(), Workspace::new());
        let stats = rasterize(&gaussians, &cameras, &settings, &mut workspace, images).unwrap();
        // 0.995^k > 1e-4
        let drawn = (1e-4_f64.ln() / 0.995_f64.ln()) as usize;
        assert!((stats.pairs as usize).abs_diff(drawn) <= 1, "{}", stats.pairs);
        assert_eq!((stats.splats, stats.entries), (N, N));
        assert!((alpha[0] - 0.9999).abs() < 1e-5 && (image[1] - 0.5 * alpha[0]).abs() < 1e-5);
        let mut opacities = vec![f32::NAN; N];
        let gradients = Gradients { opacities: Some(Target::write(&mut opacities)), ..Gradients::default() };
        let cotangents = Cotangents { image: Some(&[1.0; 3]), ..Cotangents::default() };
        rasterize_backward(&gaussians, &cameras, &settings, &mut workspace, &cotangents, gradients).unwrap();
        assert!(opacities.iter().all(|x| x.is_finite()));
        let pairs = stats.pairs as usize;
        let (front, behind) = if equal { (0..pairs, pairs..N) } else { (N - pairs..N, 0..N - pairs) };
        assert!(opacities[front].iter().all(|&x| x != 0.0) && opacities[behind].iter().all(|&x| x == 0.0));
    }
}

#[test]
fn nothing_to_draw_is_background() {
    for (width, height) in [(1, 1), (1, 33), (17, 1), (16, 16), (31, 65)] {
        for degree in [None, Some(3)] {
            let mut scene = Scene::random(0, 0, 2, (width, height), degree).to_f32();
            scene.background = vec![0.25, 0.5, 0.75];
            let (planes, stats) = scene.render_in(&mut Workspace::new());
            let pixels = 2 * width * height;
            assert_eq!(planes.image, [0.25, 0.5, 0.75].repeat(pixels));
            assert_eq!((planes.alpha, planes.depth), (vec![0.0; pixels], vec![0.0; pixels]));
            assert_eq!(stats, Default::default());
            assert_eq!(scene.gradients(&ones(&scene))[7], [pixels as f32; 3]);
        }
    }
    // No views are no pictures.
    let scene = Scene::random(0, 5, 0, (4, 4), None);
    assert!(scene.render().image.is_empty());
    assert!(scene.gradients(&ones(&scene))[0].iter().all(|&x| x == 0.0));
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
    let with = |change: &dyn Fn(&mut Scene<f64>)| {
        let mut scene = scene.clone();
        change(&mut scene);
        scene
    };
    let mut refused = |change: &dyn Fn(&mut Scene<f64>), pixels: usize, reason: &str| {
        let error = render(&with(change), pixels).unwrap_err();
        assert!(error.contains(reason), "{error}");
    };
    refused(&|_| (), 15, "image has 45 numbers, expected 48");
    refused(
        &|scene| {
            scene.means.pop();
        },
        16,
        "means has 8 numbers, expected 9",
    );
    refused(
        &|scene| {
            scene.quats.pop();
        },
        16,
        "quats has 11 numbers, expected 12",
    );
    refused(
        &|scene| {
            scene.scales.pop();
        },
        16,
        "scales has 8 numbers, expected 9",
    );
    refused(
        &|scene| {
            scene.colors.pop();
        },
        16,
        "colors has 8 numbers, expected 9",
    );
    refused(
        &|scene| {
            scene.features.pop();
        },
        16,
        "features has 5 numbers, expected 6",
    );
    refused(
        &|scene| {
            scene.viewmats.pop();
        },
        16,
        "viewmats has 11 numbers, expected 12",
    );
    refused(
        &|scene| {
            scene.background.pop();
        },
        16,
        "background has 2 numbers, expected 3",
    );
    refused(&|scene| scene.degree = Some(5), 16, "degree 5");
    refused(&|scene| scene.height = 0, 0, "4 x 0");
    refused(&|scene| scene.width = usize::MAX, 0, "pixels");
    refused(&|scene| scene.background[1] = f64::NAN, 16, "background");
    refused(&|scene| scene.channels = usize::MAX, 16, "features");
    // The last forward failed, so there is nothing to go back from.
    let backward = |scene: &Scene<f64>, cotangents: &Cotangents<'_, f64>, workspace: &mut Workspace<f64>| {
        let (gaussians, cameras, none) = (scene.gaussians(), scene.cameras(), Gradients::default());
        rasterize_backward(&gaussians, &cameras, &scene.settings, workspace, cotangents, none)
            .map_err(|error| error.to_string())
    };
    let none = Cotangents::default();
    assert!(backward(&scene, &none, &mut workspace).unwrap_err().contains("workspace of a forward"));
    scene.render_in(&mut workspace);
    assert!(backward(&scene, &none, &mut workspace).is_ok());
    let short = Cotangents { alpha: Some(&[0.0; 15]), ..none };
    let error = backward(&scene, &short, &mut workspace).unwrap_err();
    assert!(error.contains("cotangent of alpha has 15 numbers, expected 16"), "{error}");
    let other = with(&|scene| scene.settings.antialiased = true);
    assert!(backward(&other, &none, &mut workspace).unwrap_err().contains("same sizes and settings"));
}
