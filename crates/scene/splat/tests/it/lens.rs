//! Gaussians through lenses: against the slow twin, central differences, and one another.

use crate::scene::{NAMES, Planes, Scene, relative};
use proptest::prelude::*;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::lens::{self, Lens};
use weaver_geometry::{Distortion, Intrinsics};
use weaver_kernels::random::Stream;
use weaver_scene::Model;
use weaver_splat::{RasterError, RasterSettings, Region, TileSide, Workspace, rasterize_backward, reference};

fn lenses() -> impl Strategy<Value = Lens> {
    let small = || [-0.003..0.003f64, -0.003..0.003];
    let k = || [-0.03..0.03f64, -0.01..0.01, -0.002..0.002, -0.0002..0.0002];
    prop_oneof![
        2 => Just(Lens::Equirectangular),
        1 => Just(Lens::EQUIDISTANT),
        1 => Just(Lens::PINHOLE),
        1 => k().prop_map(|k| Lens::Distorted(Distortion::Fisheye { k })),
        1 => (k(), small(), small()).prop_map(|(k, p, s)| Lens::Distorted(Distortion::ThinPrismFisheye { k, p, s })),
        1 => (0.3..2.8f64).prop_map(|omega| Lens::Distorted(Distortion::Fov { omega })),
        1 => (k(), small()).prop_map(|([a, b, c, d], p)| {
            let s = [0.002, 0.0, -0.001, 1e-4];
            Lens::Distorted(Distortion::RadTanThinPrism { k: [a, b, c, d, 0.0, 0.0], p, s })
        }),
    ]
}

/// The intrinsics of a lens that shows 200 degrees, a pinhole 90, or the whole sphere.
fn intrinsics(lens: Lens, (width, height): (usize, usize)) -> Intrinsics {
    match lens {
        Lens::Equirectangular => lens::equirectangular(width, height),
        Lens::PINHOLE => Intrinsics { fx: 0.5 * width as f64, ..lens::fisheye(2.0, width, height) },
        _ => lens::fisheye(200_f64.to_radians(), width, height),
    }
}

/// Gaussians on all sides of cameras that look in nearly the same direction.
fn around(seed: u64, n: usize, views: usize, size: (usize, usize), degree: Option<usize>, lens: Lens) -> Scene<f64> {
    let mut scene = Scene::random(seed, n, views, size, degree);
    let stream = Stream::new(seed, 7, "splat.lens");
    for i in 0..n {
        let normal = |k: usize| stream.normal::<f64>((4 * i + k) as u64);
        let direction = DVec3::new(normal(0), normal(1), normal(2)).normalize_or(DVec3::Z);
        scene.means[3 * i..3 * i + 3].copy_from_slice(&(direction * (1.5 + normal(3).abs())).to_array());
    }
    let Intrinsics { fx, fy, cx, cy } = intrinsics(lens, size);
    scene.intrinsics = [fx, fy, cx, cy].repeat(views);
    scene.model = Model::Lens(lens);
    scene
}

fn twin(scene: &Scene<f64>) -> Planes<f64> {
    let r = reference::rasterize(&scene.gaussians(), &scene.cameras(), &scene.settings).unwrap();
    Planes { image: r.image, alpha: r.alpha, depth: r.depth, features: r.features }
}

fn loss(scene: &Scene<f64>, cotangents: &Planes<f64>) -> f64 {
    scene.render().flat().iter().zip(cotangents.flat()).map(|(a, b)| a * b).sum()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 8, failure_persistence: None, ..Default::default() })]

    /// Promise (scenes): Gaussians through any lens are drawn as by every ray and every Gaussian, one by one.
    #[test]
    fn agrees_with_every_gaussian_at_every_ray(
        seed: u64,
        n in 0_usize..60,
        views in 1_usize..3,
        size in (1_usize..50, 1_usize..40),
        degree in prop::option::of(0_usize..=3),
        lens in lenses(),
        antialiased: bool,
        tile in prop::sample::select(vec![TileSide::Sixteen, TileSide::ThirtyTwo, TileSide::SixtyFour]),
        thin: bool,
        channels in prop::sample::select(vec![0_usize, 2]),
        region in prop::option::of(any::<(prop::sample::Index, prop::sample::Index)>()),
        groups in prop::option::of(1_usize..4),
    ) {
        let mut scene = around(seed, n, views, size, degree, lens).with_channels(channels);
        if let Some(count) = groups {
            scene = scene.in_groups(count);
        }
        scene.settings = RasterSettings { antialiased, tile, ..RasterSettings::default() };
        if let Some((x, y)) = region {
            let (x, y) = (x.index(size.0), y.index(size.1));
            scene.settings.region = Some(Region { x, y, width: size.0 - x, height: size.1 - y });
        }
        if thin {
            scene.scales.iter_mut().step_by(3).for_each(|s| *s *= 1e-3);
        }
        let expected = twin(&scene).flat();
        prop_assert!(relative(&scene.render().flat(), &expected, 1e-3) < 1e-9, "{lens:?}");
        // Thresholds may fall on either side; elsewhere single precision is as good.
        let single = scene.to_f32().render().flat();
        let apart = single.iter().zip(&expected).filter(|(a, b)| (**a - **b).abs() > 2e-3 * (1.0 + b.abs())).count();
        prop_assert!(apart * 50 <= expected.len() + 50, "{lens:?}: {apart} of {}", expected.len());
    }

    /// Promise (scenes): gradients through any lens are those of central differences.
    #[test]
    fn gradients_are_central_differences(
        seed: u64,
        n in 1_usize..5,
        views in 1_usize..3,
        size in (1_usize..9, 1_usize..9),
        degree in prop::option::of(0_usize..=3),
        lens in lenses(),
        antialiased: bool,
    ) {
        let mut scene = around(seed, n, views, size, degree, lens);
        scene.settings.antialiased = antialiased;
        // Large ones, whose alphas pass few thresholds.
        scene.scales.iter_mut().for_each(|s| *s = 1.0 + s.min(1.0));
        scene.opacities.iter_mut().for_each(|o| *o = 0.2 + 0.6 * *o);
        let cotangents = scene.cotangents(seed);
        let scale: f64 = cotangents.flat().iter().map(|x| x.abs()).sum();
        let gradients = scene.gradients(&cotangents);
        for part in (0..9).filter(|part| NAMES[*part] != "intrinsics") {
            for (at, &own) in gradients[part].iter().enumerate() {
                let slope = |step: f64| {
                    let moved = |by: f64| {
                        let mut moved = scene.clone();
                        moved.parts()[part][at] += by;
                        loss(&moved, &cotangents)
                    };
                    (8.0 * (moved(step) - moved(-step)) - (moved(2.0 * step) - moved(-2.0 * step))) / (12.0 * step)
                };
                // A long step may cross a threshold, or a knot of the size of pixels, that a short one does not.
                let close = |slope: f64| (slope - own).abs() <= 1e-5 * own.abs() + 1e-8 * scale;
                let steps = [1e-4, 1e-5, 1e-6, 1e-7];
                prop_assert!(
                    steps.iter().any(|step| close(slope(*step))),
                    "{lens:?} {}[{at}]: {own}, not {:?}", NAMES[part], steps.map(slope)
                );
            }
        }
    }

    /// Near its axis a lens sees as a pinhole does.
    #[test]
    fn near_the_axis_every_lens_is_a_pinhole(seed: u64, lens in lenses()) {
        prop_assume!(!matches!(lens, Lens::Distorted(Distortion::Fov { .. })));
        let mut scene = Scene::random(seed, 20, 1, (32, 32), Some(1));
        let f = 3000.0;
        scene.intrinsics = vec![f, f, 16.0, 16.0];
        for (i, mean) in scene.means.chunks_exact_mut(3).enumerate() {
            mean[2] = 2.0 + i as f64;
            (mean[0], mean[1]) = (mean[0].clamp(-3.0, 3.0) * 0.002, mean[1].clamp(-3.0, 3.0) * 0.002);
        }
        scene.scales.iter_mut().for_each(|s| *s *= 0.02);
        scene.viewmats = vec![1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let plane = scene.render();
        scene.model = Model::Lens(lens);
        let seen = scene.render();
        prop_assert!(relative(&seen.image, &plane.image, 1e-3) < 5e-3, "{lens:?}");
        prop_assert!(relative(&seen.depth, &plane.depth, 1e-3) < 5e-3, "{lens:?}");
    }
}

/// A sphere has no seam and no poles but on its image: a turned camera draws the same at every direction.
#[test]
fn spheres_have_neither_seam_nor_poles() {
    let size = (128, 64);
    let mut scene = around(3, 40, 1, size, Some(2), Lens::Equirectangular);
    scene.scales.iter_mut().for_each(|s| *s = 0.4 + 0.2 * *s);
    let turn = |scene: &mut Scene<f64>, rotation: DMat3| {
        let rows = rotation.transpose().to_cols_array_2d();
        scene.viewmats = rows.iter().flat_map(|row| [row[0], row[1], row[2], 0.0]).collect();
    };
    turn(&mut scene, DMat3::IDENTITY);
    let (straight, projection, k) =
        (scene.render(), Lens::Equirectangular.projection(), intrinsics(Lens::Equirectangular, size));
    // Half a turn about the vertical moves every pixel by half a row; a turn about the forward axis brings poles about.
    turn(&mut scene, DMat3::from_rotation_y(std::f64::consts::PI));
    let half = scene.render();
    for y in 0..64 {
        for x in 0..128 {
            let (a, b) = (straight.alpha[128 * y + x], half.alpha[128 * y + (x + 64) % 128]);
            assert!((a - b).abs() < 1e-9, "{x} {y}: {a} {b}");
        }
    }
    let roll = DMat3::from_rotation_z(std::f64::consts::FRAC_PI_2);
    turn(&mut scene, roll);
    let rolled = scene.render();
    let mut worst = 0.0_f64;
    for (i, alpha) in rolled.alpha.iter().enumerate() {
        let at = weaver_geometry::glam::DVec2::new((i % 128) as f64 + 0.5 - k.cx, (i / 128) as f64 + 0.5 - k.cy);
        let ray = projection.ray(at / k.fx).unwrap();
        let before = projection.project(roll.transpose() * ray).unwrap() * k.fx;
        let (x, y) = (before.x + k.cx - 0.5, before.y + k.cy - 0.5);
        // Between the four pixels around; beyond the last row the pole is near, on the other side.
        let pixel = |x: f64, y: f64| straight.alpha[128 * y.clamp(0.0, 63.0) as usize + x.rem_euclid(128.0) as usize];
        let (s, t) = (x - x.floor(), y - y.floor());
        let row = |y: f64| (1.0 - s) * pixel(x.floor(), y) + s * pixel(x.floor() + 1.0, y);
        worst = worst.max((alpha - ((1.0 - t) * row(y.floor()) + t * row(y.floor() + 1.0))).abs());
    }
    assert!(worst < 0.05, "{worst}");
    assert!(straight.alpha.iter().filter(|a| **a > 0.5).count() > 1000);
}

#[test]
fn gaussians_behind_beside_and_in_the_camera() {
    let mut scene = around(1, 1, 1, (64, 32), None, Lens::Equirectangular);
    scene.viewmats = vec![1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    scene.scales = vec![0.1; 3];
    scene.opacities = vec![0.9];
    let seen = |scene: &Scene<f64>| {
        let alpha = scene.render().alpha;
        (0..alpha.len()).filter(|i| alpha[*i] > 0.3).map(|i| (i % 64, i / 64)).collect::<Vec<_>>()
    };
    // Behind: at both ends of the middle rows.
    scene.means = vec![0.0, 0.0, -2.0];
    assert_eq!(seen(&scene), [(0, 15), (63, 15), (0, 16), (63, 16)]);
    // Overhead: all of the first row.
    scene.means = vec![0.0, -2.0, 0.0];
    assert_eq!(seen(&scene), (0..64).map(|x| (x, 0)).collect::<Vec<_>>());
    // In the camera: nowhere.
    scene.means = vec![0.0; 3];
    assert_eq!(seen(&scene), []);
    // A fisheye of 200 degrees sees beside the camera, and nothing behind it.
    let mut scene = around(1, 1, 1, (41, 41), None, Lens::EQUIDISTANT);
    (scene.scales, scene.opacities) = (vec![0.1; 3], vec![0.9]);
    scene.viewmats = vec![1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let brightest = |scene: &Scene<f64>| {
        let alpha = scene.render().alpha;
        let at = (0..alpha.len()).max_by(|a, b| alpha[*a].total_cmp(&alpha[*b])).unwrap();
        (alpha[at] > 0.5).then_some((at % 41, at / 41))
    };
    scene.means = vec![2.0, 0.0, 0.0];
    assert_eq!(brightest(&scene), Some((38, 20)));
    scene.means = vec![0.0, 0.0, -2.0];
    assert_eq!(brightest(&scene), None);
}

#[test]
fn single_and_double_threads_draw_the_same_bits() {
    let scene = around(9, 3000, 1, (200, 120), Some(1), Lens::EQUIDISTANT).to_f32();
    let cotangents = around(9, 3000, 1, (200, 120), Some(1), Lens::EQUIDISTANT).cotangents(1).to_f32();
    let drawn = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| (scene.render(), scene.gradients(&cotangents)))
    };
    let (a, b) = (drawn(1), drawn(3));
    assert_eq!(a.0, b.0);
    assert!(a.1.iter().zip(&b.1).all(|(a, b)| a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())));
}

#[test]
fn wrong_uses_of_lenses_are_errors() {
    let message = |result: Result<(), RasterError>| result.unwrap_err().to_string();
    let scene = around(5, 3, 2, (8, 6), None, Lens::EQUIDISTANT);
    let draw = |scene: &Scene<f64>, workspace: &mut Workspace<f64>| {
        let pixels = scene.pixels();
        let (mut image, mut alpha, mut features) = (vec![0.0; 3 * pixels], vec![0.0; pixels], vec![0.0; 2 * pixels]);
        let images =
            weaver_splat::Images { image: &mut image, alpha: &mut alpha, depth: None, features: Some(&mut features) };
        weaver_splat::rasterize(&scene.gaussians(), &scene.cameras(), &scene.settings, workspace, images).map(drop)
    };
    let mut workspace = Workspace::new();
    let mut other = scene.clone();
    other.intrinsics[4] *= 1.1;
    assert!(message(draw(&other, &mut workspace)).contains("the same intrinsics"));
    other.intrinsics = [0.0, 1.0, 1.0, 1.0].repeat(2);
    assert!(message(draw(&other, &mut workspace)).contains("focal lengths above 0"));
    draw(&scene, &mut workspace).unwrap();
    assert!(workspace.splats().unwrap_err().to_string().contains("a lens"));
    let (cotangents, mut slopes) = (weaver_splat::Cotangents::default(), [0.0; 8]);
    let gradients = || weaver_splat::Gradients::default();
    let mut backward = |scene: &Scene<f64>, gradients| {
        message(rasterize_backward(
            &scene.gaussians(),
            &scene.cameras(),
            &scene.settings,
            &mut workspace,
            &cotangents,
            gradients,
        ))
    };
    let wanted = weaver_splat::Gradients { intrinsics: Some(weaver_splat::Target::write(&mut slopes)), ..gradients() };
    assert!(backward(&scene, wanted).contains("no gradient of the intrinsics"));
    let plane = Scene { model: Model::Pinhole, ..scene.clone() };
    assert!(backward(&plane, gradients()).contains("the workspace of a forward"));
    // A rasterizer that knows pinholes alone says so.
    let extent = weaver_splat::Extent::of(&scene.gaussians(), &scene.cameras(), &scene.settings, false);
    assert!(extent.unwrap_err().to_string().contains("pinhole cameras only"));
}
