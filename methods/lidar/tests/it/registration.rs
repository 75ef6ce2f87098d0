//! Planted motions, undetermined directions, and clouds from several places.

use crate::hall::{range, scan};
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Pose, so3};
use weaver_kernels::order::median_high;
use weaver_lidar::{
    Error, Frame, GeometricSettings, Lost, PatchTree, RangeReference, Scan, SurfelCamera, register, register_ranges,
};

fn frame(pose: &Pose) -> Frame {
    let camera = SurfelCamera::spherical([512, 32], [-0.51, 0.51]);
    Frame::new(&scan(pose, 64, 1024), &camera, "hall").unwrap()
}

fn planted(meters: f64, degrees: f64) -> Pose {
    let axis = DVec3::new(0.3, -0.5, 1.0).normalize();
    Pose::new(so3::exp(axis * degrees.to_radians()), DVec3::new(0.8, 0.6, 0.1).normalize() * meters)
}

/// The geometric stage finds half a meter and five degrees.
#[test]
fn the_geometric_stage_finds_large_motions() {
    let reference = frame(&Pose::IDENTITY);
    let tree = PatchTree::new(&reference.points);
    // The scan itself, moved: the only error is the registration's.
    let truth = planted(0.5, 5.0);
    let query: Vec<DVec3> = reference.points.iter().map(|p| truth.inverse().apply(*p)).collect();
    let settings = GeometricSettings { steps: 30, ..Default::default() };
    let found = register(&query, &tree, &Pose::IDENTITY, &settings).unwrap();
    let error = truth.inverse().compose(&found.pose);
    assert!(error.translation.length() < 1e-3, "{:?}", error.translation);
    assert!(error.angle_to(&Pose::IDENTITY).to_degrees() < 0.01);
    assert!(found.fitness > 0.95);
}

#[test]
fn the_range_stage_finds_two_decimeters_and_a_degree() {
    let camera = SurfelCamera::spherical([2048, 256], [-0.51, 0.51]);
    let drawn = (0..camera.pixels()).map(|i| range(DVec3::ZERO, camera.pixel_ray(i % 2048, i / 2048))).collect();
    let reference = RangeReference::new(&camera, drawn);
    let truth = planted(0.2, 1.0);
    let query = Frame::new(&scan(&truth, 64, 1024), &camera, "hall").unwrap();
    let found = register_ranges(&query.points, &reference, &Pose::IDENTITY, 10).unwrap();
    let error = truth.inverse().compose(&found.pose);
    assert!(error.translation.length() < 1e-3, "{:?}", error.translation);
    assert!(error.angle_to(&Pose::IDENTITY).to_degrees() < 0.01);
}

#[test]
fn there_and_back_is_the_identity() {
    let (a, b) = (frame(&Pose::IDENTITY), frame(&planted(0.3, 2.0)));
    let settings = GeometricSettings { steps: 20, ..Default::default() };
    let one_way = |from: &Frame, to: &Frame| {
        register(&from.points, &PatchTree::new(&to.points), &Pose::IDENTITY, &settings).unwrap().pose
    };
    let both = one_way(&a, &b).compose(&one_way(&b, &a));
    assert!(both.translation.length() < 2e-2, "{:?}", both.translation);
    assert!(both.angle_to(&Pose::IDENTITY).to_degrees() < 0.1);
}

#[test]
fn a_corridor_without_ends_is_not_determined() {
    let corridor = |ends: bool| -> Vec<DVec3> {
        let mut points = Vec::new();
        for i in 0..200 {
            for k in 0..10 {
                let (x, t) = (f64::from(i) * 0.1 - 10.0, f64::from(k) / 5.0 - 0.9);
                points.extend([DVec3::new(x, -1.0, t), DVec3::new(x, 1.0, t), DVec3::new(x, t, -1.0)]);
                if ends {
                    points.push(DVec3::new(10.0, t, f64::from(i) / 100.0 - 1.0));
                }
            }
        }
        points
    };
    let smallest = |points: &[DVec3]| {
        register(points, &PatchTree::new(points), &Pose::IDENTITY, &Default::default())
            .map(|found| found.equations.eigenvalues()[0])
    };
    let closed = smallest(&corridor(true)).unwrap();
    match smallest(&corridor(false)) {
        Ok(open) => assert!(open < 1e-3 * closed, "{open} {closed}"),
        Err(lost) => assert_eq!(lost, Lost::Singular),
    }
    assert_eq!(smallest(&[DVec3::X; 5]), Err(Lost::FewMatches));
}

/// Merged clouds and poor scans are refused with the reason.
#[test]
fn merged_clouds_and_poor_scans_are_refused() {
    let near = scan(&Pose::IDENTITY, 96, 2048);
    near.check_single("hall").unwrap();
    let apart = Pose::new(DMat3::IDENTITY, DVec3::new(5.0, -3.0, 0.5));
    let mut merged = near.points.clone();
    // As if both were taken at one place.
    merged.extend(scan(&apart, 96, 2048).points);
    let error = Scan::new(merged).check_single("merged.bin").unwrap_err();
    assert!(matches!(error, Error::NotOneScan { .. }), "{error}");
    assert!(error.to_string().starts_with("merged.bin: expected a single scan"), "{error}");

    let camera = SurfelCamera::spherical([512, 32], [-0.51, 0.51]);
    let few = Frame::new(&Scan::new(vec![[1.0, 0.0, 0.0]; 500]), &camera, "few.bin").unwrap_err();
    assert_eq!(few.to_string(), "few.bin: expected at least 100 pixels with a range, found 1");

    let (kept, dropped) = Scan::new(vec![[f32::NAN, 0.0, 0.0], [2.0, 0.0, 0.0], [0.1, 0.0, 0.0]]).within([1.0, 9.0]);
    assert_eq!((kept.points.len(), dropped), (1, [2, 1]));
}

#[test]
fn the_nearest_point_of_a_pixel_wins() {
    let camera = SurfelCamera::spherical([512, 32], [-0.51, 0.51]);
    let mut points = scan(&Pose::IDENTITY, 64, 1024).points;
    points.push([0.5, 0.0, 0.001]);
    let frame = Frame::new(&Scan::new(points), &camera, "hall").unwrap();
    let ahead = frame.range[15 * 512 + 256].min(frame.range[15 * 512 + 255]);
    assert!((ahead - 0.5).abs() < 1e-5, "{ahead}");
    // The azimuth of exactly half a turn is in the first or the last column.
    let wrapped = Frame::new(&scan(&Pose::new(DMat3::from_rotation_z(3.0), DVec3::ZERO), 64, 1024), &camera, "hall");
    assert!(wrapped.unwrap().range.iter().all(|r| *r > 0.0));
}

/// Beams beside the middles of pixels measure other ranges there, which normals correct.
///
/// Promise (results): range images of a lidar hold the ranges of the middles of pixels, wherever beams went.
#[test]
fn ranges_are_brought_to_the_middles_of_pixels() {
    let camera = SurfelCamera::spherical([512, 32], [-0.51, 0.51]);
    let frame = Frame::new(&scan(&Pose::IDENTITY, 50, 900), &camera, "hall").unwrap();
    let median = |frame: &Frame| {
        let exact = |pixel: usize| range(DVec3::ZERO, camera.pixel_ray(pixel % 512, pixel / 512));
        let error = |pixel: &u32| (f64::from(frame.range[*pixel as usize]) - exact(*pixel as usize)).abs();
        let mut errors: Vec<f64> = frame.pixels.iter().map(error).collect();
        median_high(&mut errors).unwrap()
    };
    let (before, after) = (median(&frame), median(&frame.clone().with_normals()));
    assert!(before > 0.005 && after < 1e-5, "{before} {after}");
}
