//! One surfel, whose range is known.

use crate::scene::{draw, facing, sight};
use std::f64::consts::PI;
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
use weaver_surfel::{SurfelCamera, Surfels};

fn one(center: DVec3, normal: DVec3, scale: f64, logit: f64) -> Surfels<f64> {
    let (q, mut surfels) = (facing(normal, 0.3), Surfels::default());
    surfels.push(center.to_array(), [q.w, q.x, q.y, q.z], [scale.ln(); 2], logit);
    surfels
}

#[test]
fn a_plane_has_its_range() {
    let (center, normal) = (DVec3::new(3.0, 1.0, 0.5), DVec3::new(-1.0, 0.2, 0.1).normalize());
    let (surfels, camera) = (one(center, normal, 1.0, 9.0), SurfelCamera::spherical([256, 64], [-0.6, 0.6]));
    let poses = [Pose::IDENTITY];
    let (_, images) = draw(&sight(&surfels, &camera, &poses));
    let range = images.mean_range();
    let mut seen = 0;
    for i in (0..camera.pixels()).filter(|i| images.opacity[*i] > 0.0) {
        let ray = camera.pixel_ray(i % 256, i / 256);
        let expected = normal.dot(center) / normal.dot(ray);
        // Pixels beside the center may come from the low-pass filter.
        if (range[i] - expected).abs() > 1e-9 {
            assert!((range[i] - center.length()).abs() < 1e-9, "{} {expected}", range[i]);
        } else {
            seen += 1;
        }
    }
    assert!(seen > 1000, "{seen}");
}

#[test]
fn the_seam_leaves_no_trace() {
    // Turned by a whole number of columns, the image turns along.
    let camera = SurfelCamera::spherical([128, 32], [-0.6, 0.6]);
    let step = 2.0 * PI / 128.0;
    let at = |columns: f64| {
        let turned = |v: DVec3| {
            let (sin, cos) = (columns * step).sin_cos();
            DVec3::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z)
        };
        let surfels = one(turned(DVec3::new(4.0, 0.1, 0.3)), turned(DVec3::new(-1.0, 0.1, 0.2)), 0.5, 2.0);
        draw(&sight(&surfels, &camera, &[Pose::IDENTITY])).1
    };
    let (ahead, behind) = (at(0.0), at(64.0));
    for i in 0..camera.pixels() {
        let (row, column) = (i / 128, i % 128);
        let other = row * 128 + (column + 128 - 64) % 128;
        assert!((ahead.opacity[i] - behind.opacity[other]).abs() < 1e-9);
        assert!((ahead.range[i] - behind.range[other]).abs() < 1e-8);
    }
    assert!(behind.opacity[16 * 128] > 0.5 && behind.opacity[16 * 128 + 127] > 0.5);
}

#[test]
fn poles_are_covered() {
    let camera = SurfelCamera::spherical([64, 32], [-PI / 2.0, PI / 2.0]);
    for (center, row) in [(DVec3::new(0.05, -0.1, 3.0), 0), (DVec3::new(-0.1, 0.02, -2.0), 31)] {
        let surfels = one(center, -center, 0.6, 4.0);
        let (_, images) = draw(&sight(&surfels, &camera, &[Pose::IDENTITY]));
        for column in 0..64 {
            let at = row * 64 + column;
            assert!(images.opacity[at] > 0.8, "column {column}: {}", images.opacity[at]);
            assert!((images.mean_range()[at] - center.length()).abs() < 0.1);
        }
    }
}

#[test]
fn backs_and_what_is_out_of_reach_are_not_seen() {
    let camera = SurfelCamera::spherical([64, 16], [-0.6, 0.6]);
    for surfels in [
        one(DVec3::new(3.0, 0.0, 0.0), DVec3::X, 1.0, 4.0),
        one(DVec3::new(130.0, 0.0, 0.0), -DVec3::X, 9.0, 4.0),
        one(DVec3::new(0.05, 0.0, 0.0), -DVec3::X, 1.0, 4.0),
        one(DVec3::new(3.0, 0.0, 0.0), -DVec3::X, 1.0, -9.0),
    ] {
        let (_, images) = draw(&sight(&surfels, &camera, &[Pose::IDENTITY]));
        assert!(images.opacity.iter().all(|a| *a == 0.0));
    }
}

#[test]
fn numbers_that_are_not_finite_are_counted() {
    let camera = SurfelCamera::spherical([64, 16], [-0.6, 0.6]);
    let mut surfels = one(DVec3::new(3.0, 0.0, 0.0), -DVec3::X, 1.0, 4.0);
    surfels.push([f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0; 2], 1.0);
    surfels.push([2.0, 0.0, 0.0], [0.0; 4], [0.0; 2], 1.0);
    let poses = [Pose::IDENTITY];
    let sight = sight(&surfels, &camera, &poses);
    let stats = weaver_surfel::SurfelWorkspace::new().draw(&sight, &mut Default::default()).unwrap();
    assert_eq!((stats.covered, stats.rejected), (1, 2));
}
