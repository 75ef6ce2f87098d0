//! Distortion that photos determine, that they do not determine, and that is not requested.

use super::*;
use crate::bundle::Lens;
use weaver_geometry::glam::{DMat3, DVec2};
use weaver_geometry::{Intrinsics, so3};
use weaver_kernels::random::Stream;

/// Cameras around a cloud of points, rolled, who see all of it through this lens, a third of a pixel off.
fn seen_through(lens: Lens, cameras: usize) -> Bundle {
    let stream = Stream::new(1, cameras as u64, "test.distortion");
    let draw = |k: usize| 2.0 * stream.uniform::<f64>(k as u64) - 1.0;
    let intrinsics = Intrinsics { fx: 300.0, fy: 300.0, cx: 200.0, cy: 150.0 };
    let camera = |i: usize| {
        let turn = DVec3::new(0.1 * draw(3 * i), 2.0 * draw(3 * i + 1), 0.0);
        let rotation = so3::exp(DVec3::Z * draw(3 * i + 2)) * so3::exp(turn);
        Camera { pose: Pose::new(rotation, DVec3::new(0.0, 0.0, 3.0)), intrinsics, width: 400, height: 300 }
    };
    let points = (0..400).map(|n| 1.2 * DVec3::new(draw(1000 + 3 * n), draw(1001 + 3 * n), draw(1002 + 3 * n)));
    let mut bundle = Bundle {
        cameras: (0..cameras).map(camera).collect(),
        lenses: vec![Lens { free_focal: true, ..Lens::default() }],
        lens_of: vec![0; cameras],
        fixed: vec![false; cameras],
        points: points.collect(),
        ..Bundle::default()
    };
    for (point, position) in bundle.points.iter().enumerate() {
        for (number, camera) in bundle.cameras.iter().enumerate() {
            let noise = |k: usize| stream.normal::<f64>((10_000 + 2 * (cameras * point + number) + k) as u64) / 3.0;
            let pixel = lens.project(camera, camera.pose.apply(*position));
            if pixel.x > 0.0 && pixel.y > 0.0 && pixel.x < 400.0 && pixel.y < 300.0 {
                let pixel = DVec2::new(pixel.x + noise(0), pixel.y + noise(1));
                bundle.observations.push(Observation { camera: number, point, pixel, deviation: 1.0 });
            }
        }
    }
    bundle.adjust(4.0, 40);
    bundle
}

/// The freed coefficients, and their values.
fn freed(planted: [f64; 2], cameras: usize, find: Find) -> ([bool; 2], [f64; 2]) {
    let lens = Lens { k1: planted[0], k2: planted[1], ..Lens::default() };
    let mut bundle = seen_through(lens, cameras);
    let any = bundle.free_distortion(find, &vec![true; cameras]);
    bundle.adjust(1.0, 40);
    let Lens { k1, k2, free_k1, free_k2, .. } = bundle.lenses[0];
    assert_eq!(any, free_k1 || free_k2);
    ([free_k1, free_k2], [k1, k2])
}

/// Promise (figures): k1 and k2 are freed where photos determine them, and on request.
#[test]
fn both_coefficients_are_told_by_many_photos() {
    let planted = [-0.12, 0.08];
    let (free, found) = freed(planted, MANY, Find::Told);
    assert_eq!(free, [true, true]);
    assert!(found.iter().zip(planted).all(|(found, planted)| (found - planted).abs() < 0.01), "{found:?}");
    // Enough photos to determine the first one; then too few to look.
    assert_eq!(freed(planted, MANY - 1, Find::Told).0, [true, false]);
    assert_eq!(freed(planted, SEVERAL - 1, Find::Told).0, [false, false]);
}

/// Promise of `both_coefficients_are_told_by_many_photos`.
#[test]
fn absent_distortion_is_not_freed() {
    let (free, found) = freed([-0.12, 0.0], MANY, Find::Told);
    assert_eq!(free, [true, false]);
    assert!((found[0] + 0.12).abs() < 0.01, "{found:?}");
    assert_eq!(freed([0.0, 0.0], MANY, Find::Told), ([false, false], [0.0, 0.0]));
    assert_eq!(freed([-0.12, 0.08], MANY, Find::Off).0, [false, false]);
    let (free, found) = freed([0.0, 0.0], SEVERAL, Find::K1K2);
    assert!(free == [true, true] && found.iter().all(|k| k.abs() < 0.05), "{found:?}");
    assert_eq!(freed([0.0, 0.0], SEVERAL, Find::K1).0, [true, false]);
}

/// Cameras before points on a wall, which errors of both kinds have moved: noise, and for each photo a smooth field of
/// so many pixels.
fn before_a_wall(poses: &[Pose], noise: f64, smooth: f64, seed: u64) -> Bundle {
    before_relief(poses, 0.0, [noise, smooth], seed)
}

/// The same before points that are so far before and behind the wall.
fn before_relief(poses: &[Pose], relief: f64, [noise, smooth]: [f64; 2], seed: u64) -> Bundle {
    let stream = Stream::new(seed, poses.len() as u64, "test.wall");
    let draw = |k: usize| 2.0 * stream.uniform::<f64>(k as u64) - 1.0;
    let intrinsics = Intrinsics { fx: 360.0, fy: 360.0, cx: 200.0, cy: 150.0 };
    let camera = |pose: &Pose| Camera { pose: *pose, intrinsics, width: 400, height: 300 };
    let mut bundle = Bundle {
        cameras: poses.iter().map(camera).collect(),
        lenses: vec![Lens { free_focal: true, weight: 1.0, ..Lens::default() }],
        lens_of: vec![0; poses.len()],
        fixed: vec![false; poses.len()],
        points: (0..400)
            .map(|n| {
                let z = 4.0 + relief * draw(2000 + n);
                DVec3::new(2.2 * draw(1000 + 2 * n), 1.6 * draw(1001 + 2 * n), z)
            })
            .collect(),
        ..Bundle::default()
    };
    for (point, position) in bundle.points.iter().enumerate() {
        for (number, camera) in bundle.cameras.iter().enumerate() {
            let pixel = intrinsics.project(camera.pose.apply(*position));
            let off = |k: usize| {
                let [x, y] = [pixel.x / 200.0 - 1.0, pixel.y / 200.0 - 0.75];
                let field = [x * x, x * y, y * y].into_iter().enumerate();
                let field: f64 = field.map(|(i, of)| of * draw(10 * number + 3 * k + i)).sum();
                smooth * field + noise * stream.normal::<f64>((10_000 + 2 * (poses.len() * point + number) + k) as u64)
            };
            if pixel.x > 0.0 && pixel.y > 0.0 && pixel.x < 400.0 && pixel.y < 300.0 {
                let pixel = DVec2::new(pixel.x + off(0), pixel.y + off(1));
                bundle.observations.push(Observation { camera: number, point, pixel, deviation: 1.0 });
            }
        }
    }
    bundle.adjust(1.0, 100);
    bundle
}

/// Where a wall is met going towards it, along it and around it, the focal length is within three of its deviations,
/// which are small only where the wall is seen from different sides.
///
/// Promise (fits): deviations of focal lengths hold before walls.
#[test]
fn deviations_of_focal_lengths_hold_on_walls() {
    let (mut all, mut within) = (0, 0);
    for seed in 0..4 {
        for (noise, smooth) in [(0.05, 0.01), (0.3, 0.05)] {
            let of = |pose: &dyn Fn(f64) -> Pose| -> Vec<Pose> { (-3..=3).map(|i| pose(f64::from(i))).collect() };
            let sway = |i: f64| so3::exp(DVec3::new(0.02 * (2.0 * i).sin(), 0.02 * (3.0 * i).cos(), 0.0));
            let from = |turn: DMat3, center: DVec3| Pose::new(turn, -(turn * center));
            let towards = of(&|i| from(sway(i), DVec3::new(0.0, 0.02 * i.cos(), 0.2 * i)));
            let along = of(&|i| from(sway(i), DVec3::new(0.15 * i, 0.03 * i.cos(), 0.0)));
            let around = of(&|i| {
                let [sin, cos] = [(0.12 * i).sin(), (0.12 * i).cos()];
                from(so3::exp(DVec3::Y * 0.12 * i), DVec3::new(4.0 * sin, 0.05 * i.cos(), 4.0 - 4.0 * cos))
            });
            for (name, poses) in [("towards", towards), ("along", along), ("around", around)] {
                let bundle = before_a_wall(&poses, noise, smooth, seed);
                let told = Uncertainty::of(&bundle, &[true; 7]).map_or(f64::INFINITY, |u| u.focal);
                let off = bundle.lenses[0].log_focal.abs();
                all += 1;
                within += usize::from(off <= 3.0 * told);
                assert!(name != "around" || told < 0.02, "{noise}, {seed}: {told}");
            }
        }
    }
    assert!(within + 1 >= all, "{within} of {all} within three deviations");
}

/// On narrow arcs around a place with relief the focal length is within three of its deviations, which grow as the arc
/// gets narrower.
#[test]
fn deviations_of_focal_lengths_hold_on_arcs() {
    let (mut all, mut within) = (0, 0);
    let mut told_by_width = Vec::new();
    for degrees in [4.0_f64, 8.0, 16.0] {
        let mut sum = 0.0;
        for seed in 0..4 {
            for errors in [[0.05, 0.01], [0.3, 0.05]] {
                let pose = |i: i32| {
                    let angle = degrees.to_radians() * f64::from(i) / 6.0;
                    let turn = so3::exp(DVec3::Y * angle);
                    let center = DVec3::new(4.0 * angle.sin(), 0.02 * f64::from(i).cos(), 4.0 - 4.0 * angle.cos());
                    Pose::new(turn, -(turn * center))
                };
                let poses: Vec<Pose> = (-3..=3).map(pose).collect();
                let bundle = before_relief(&poses, 1.5, errors, seed);
                let told = Uncertainty::of(&bundle, &[true; 7]).map_or(f64::INFINITY, |u| u.focal);
                let off = bundle.lenses[0].log_focal.abs();
                all += 1;
                within += usize::from(off <= 3.0 * told);
                sum += told;
            }
        }
        told_by_width.push(sum);
    }
    assert!(within + 1 >= all, "{within} of {all} within three deviations");
    assert!(told_by_width.is_sorted_by(|narrow, wide| narrow > wide), "{told_by_width:?}");
}
