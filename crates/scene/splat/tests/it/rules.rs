//! The rules, one by one, at a pixel that looks straight at the centers of splats.

use crate::scene::Scene;
use weaver_scene::Model;
use weaver_splat::{RasterSettings, TileSide};

/// Round Gaussians of one gray level each on the optical axis: (depth, opacity, level). One pixel.
fn on_axis(splats: &[(f64, f64, f64)]) -> Scene<f64> {
    Scene {
        means: splats.iter().flat_map(|s| [0.0, 0.0, s.0]).collect(),
        quats: splats.iter().flat_map(|_| [1.0, 0.0, 0.0, 0.0]).collect(),
        scales: splats.iter().flat_map(|_| [0.1; 3]).collect(),
        opacities: splats.iter().map(|s| s.1).collect(),
        colors: splats.iter().flat_map(|s| [s.2; 3]).collect(),
        degree: None,
        colorless: false,
        features: Vec::new(),
        channels: 0,
        groups: None,
        viewmats: vec![1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        intrinsics: vec![10.0, 10.0, 0.5, 0.5],
        background: vec![0.0; 3],
        width: 1,
        height: 1,
        model: Model::Pinhole,
        settings: RasterSettings::default(),
    }
}

fn close(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-13, "{a} {b}");
}

#[test]
fn alpha_is_capped_and_then_has_no_gradient() {
    let mut scene = on_axis(&[(2.0, 1.0, 1.0)]);
    close(scene.render().alpha[0], 0.99);
    assert_eq!(scene.gradients(&scene.cotangents(0))[3], [0.0]);
    scene.settings.alpha_max = 0.999;
    close(scene.render().alpha[0], 0.999);
    scene.opacities[0] = 0.998;
    close(scene.render().alpha[0], 0.998);
    assert_ne!(scene.gradients(&scene.cotangents(0))[3], [0.0]);
}

#[test]
fn faint_splats_are_skipped() {
    assert_eq!(on_axis(&[(2.0, 1.0 / 255.0 - 1e-9, 1.0)]).render().alpha, [0.0]);
    close(on_axis(&[(2.0, 1.0 / 255.0 + 1e-9, 1.0)]).render().alpha[0], 1.0 / 255.0 + 1e-9);
}

#[test]
fn a_pixel_ends_before_the_splat_that_would_darken_it() {
    // T = 0.02, 0.0004; the third would leave 8e-6, and the fourth does not come after it.
    let scene = on_axis(&[(4.0, 0.5, 1.0), (3.0, 0.98, 1.0), (2.0, 0.98, 1.0), (1.0, 0.98, 1.0)]);
    close(scene.render().alpha[0], 1.0 - 0.0004);
    let gradient = scene.gradients(&scene.cotangents(0));
    assert_eq!(&gradient[3][..2], [0.0; 2]);
    assert!(gradient[3][2] != 0.0 && gradient[3][3] != 0.0);
}

#[test]
fn depth_is_accumulated_and_not_divided() {
    let planes = on_axis(&[(2.0, 0.5, 1.0), (3.0, 0.5, 0.4)]).render();
    close(planes.depth[0], 0.5 * 2.0 + 0.25 * 3.0);
    close(planes.alpha[0], 0.75);
    close(planes.image[0], 0.5 + 0.25 * 0.4);
}

#[test]
fn background_shows_through() {
    let mut scene = on_axis(&[(2.0, 0.5, 1.0)]);
    scene.background = vec![0.2, 0.4, 0.6];
    let image = scene.render().image;
    (0..3).for_each(|i| close(image[i], 0.5 + 0.5 * scene.background[i]));
}

#[test]
fn a_point_is_blurred_by_eps2d() {
    let mut scene = on_axis(&[(2.0, 0.8, 1.0)]);
    scene.scales.fill(0.0);
    scene.width = 3;
    let alpha = scene.render().alpha;
    close(alpha[0], 0.8);
    close(alpha[1], 0.8 * (-0.5_f64 / 0.3).exp());
    close(alpha[2], 0.0);
    scene.settings.antialiased = true;
    scene.settings.tile = TileSide::ThirtyTwo;
    close(scene.render().alpha[0], 0.8 * 0.005);
}

#[test]
fn order_is_by_depth_in_f32_then_by_index() {
    let near_first = on_axis(&[(3.0, 0.5, 0.0), (2.0, 0.5, 1.0)]).render();
    close(near_first.image[0], 0.5);
    let tie = on_axis(&[(2.0 + 1e-12, 0.5, 0.0), (2.0, 0.5, 1.0)]).render();
    close(tie.image[0], 0.25);
}

#[test]
fn planes_cut_by_depth() {
    let mut scene = on_axis(&[(0.005, 0.5, 1.0), (20.0, 0.5, 1.0)]);
    scene.settings.far = 10.0;
    assert_eq!(scene.render().alpha, [0.0]);
    scene.settings.near = 1e-10;
    close(scene.render().alpha[0], 0.5);
}

#[test]
fn harmonics_are_shifted_by_half_and_clamped_at_zero() {
    let mut scene = on_axis(&[(2.0, 0.5, 1.0)]);
    scene.degree = Some(0);
    scene.colors = vec![1.0, 0.0, -10.0];
    let image = scene.render().image;
    close(image[0], 0.5 * (0.5 + 0.282_094_791_773_878_14));
    close(image[1], 0.25);
    close(image[2], 0.0);
    assert_eq!(scene.gradients(&scene.cotangents(0))[4][2], 0.0);
}

#[test]
fn small_splats_can_be_left_out() {
    let mut scene = on_axis(&[(2.0, 0.5, 1.0)]);
    scene.scales.fill(0.0);
    let drawn = 3.0 * 0.3_f64.sqrt();
    for least in [None, Some(drawn - 1e-6)] {
        scene.settings.radius_clip = least;
        close(scene.render().alpha[0], 0.5);
    }
    scene.settings.radius_clip = Some(drawn + 1e-6);
    assert_eq!(scene.render().alpha, [0.0]);
}
