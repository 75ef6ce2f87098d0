//! Promises of the crate.

use crate::planted::{NORMAL, Planted, inverse_depth, wall};
use std::f64::consts::TAU;
use std::sync::LazyLock;
use weaver_geometry::Pose;
use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_scene::PointCloud;
use weaver_stereo::{Stereo, StereoSettings, best_photos};

static PLANTED: LazyLock<Planted> = LazyLock::new(|| wall(4));
static STEREO: LazyLock<Stereo> =
    LazyLock::new(|| Stereo::of(&PLANTED.photos, &PLANTED.points, &PLANTED.visible, &StereoSettings::default()));

/// A slanted wall is found nearly everywhere, to a part of a pixel.
#[test]
fn the_depth_of_a_wall_is_found() {
    let coverage = STEREO.coverage();
    assert!(coverage.iter().all(|part| *part > 0.7), "{coverage:?}");
    for (n, photo) in PLANTED.photos.iter().enumerate() {
        let (depth, [height, width]) = STEREO.depth(n);
        assert_eq!([height, width], photo.size());
        let error = |(at, depth): (usize, &f32)| {
            let pixel = DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
            (f64::from(*depth) * inverse_depth(&photo.camera, pixel)).ln().abs()
        };
        let mut errors: Vec<f64> = depth.iter().enumerate().filter(|(_, d)| !d.is_nan()).map(error).collect();
        errors.sort_unstable_by(f64::total_cmp);
        assert!(errors[errors.len() / 2] < 0.003, "median {}", errors[errors.len() / 2]);
        assert!(errors[errors.len() * 98 / 100] < 0.02, "98 of 100 {}", errors[errors.len() * 98 / 100]);
    }
}

/// Gaussians lie on the wall, flat, each part of it once, and no more than requested.
#[test]
fn gaussians_cover_the_wall_once() {
    let surface = STEREO.surface();
    let pixels = 96 * 72;
    // Four photos show about the same part of the wall: far less than four times as many pixels are left.
    assert!((pixels / 2..2 * pixels).contains(&surface.len()), "{} pixels", surface.len());
    let gaussians = surface.gaussians(500);
    assert!((450..=500).contains(&gaussians.means.len()), "{}", gaussians.means.len());
    let distance = |mean: &[f32; 3]| (NORMAL.dot(DVec3::from(mean.map(f64::from))) - 1.0).abs() / NORMAL.length();
    let far = gaussians.means.iter().filter(|mean| distance(mean) > 0.1).count();
    assert!(far < 10, "{far} of 500 more than 0.1 from a wall at a distance of 4.6");
    let along = |n: usize| {
        let [w, x, y, z] = gaussians.quats[n].map(f64::from);
        let thin = weaver_geometry::glam::DQuat::from_xyzw(x, y, z, w) * DVec3::Z;
        thin.dot(NORMAL.normalize()).abs()
    };
    let aligned = (0..gaussians.means.len()).filter(|n| along(*n) > 0.9).count();
    assert!(aligned > 400, "{aligned} of 500 lie flat");
    // Points that one photo sees have no depth there, and are not shown either.
    let views = |n: &usize| PLANTED.visible.iter().filter(|visible| visible.contains(&(*n as u32))).count();
    let shared: Vec<[f32; 3]> =
        (0..PLANTED.points.len()).filter(|n| views(n) > 1).map(|n| PLANTED.points.positions[n]).collect();
    let missing = STEREO.unexplained().positions.iter().filter(|point| shared.contains(point)).count();
    assert!(missing < 30, "{missing} points of {} are not shown", shared.len());
}

/// The same bits at any number of threads, others under another seed.
#[test]
fn bits_do_not_depend_on_threads() {
    let planted = wall(3);
    let with = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let settings = StereoSettings { seed, ..StereoSettings::default() };
        pool.install(|| {
            let stereo = Stereo::of(&planted.photos, &planted.points, &planted.visible, &settings);
            stereo.surface().gaussians(300)
        })
    };
    assert_eq!(with(1, 0), with(3, 0));
    assert_ne!(with(1, 0), with(1, 1));
}

/// No depth is found without evidence: from one photo, without points, under a mask.
#[test]
fn without_neighbors_there_is_no_depth() {
    let planted = wall(3);
    let settings = StereoSettings::default();
    let alone = Stereo::of(&planted.photos[..1], &planted.points, &planted.visible[..1], &settings);
    assert!(alone.surface().is_empty());
    let blind = Stereo::of(&planted.photos, &PointCloud::default(), &[vec![], vec![], vec![]], &settings);
    assert_eq!(blind.coverage(), [0.0; 3]);
    let mut masked = planted.photos.clone();
    masked[1].mask = Some((0..96 * 72).map(|at| at % 96 < 48).collect());
    let stereo = Stereo::of(&masked, &planted.points, &planted.visible, &settings);
    let (depth, _) = stereo.depth(1);
    assert!(depth.iter().enumerate().all(|(at, depth)| at % 96 < 48 || depth.is_nan()));
    assert!(stereo.coverage()[1] > 0.2);
}

/// Promise (scenes): where few of many photos find depth, they stand in groups that can agree, and the groups show all
/// sides of the scene.
#[test]
fn few_photos_show_most_of_what_many_do() {
    // A round walk of 90 photos, 4 degrees apart, around a ball.
    let at = |part: f64| DVec3::new((part * TAU).cos(), 0.0, (part * TAU).sin());
    let points: Vec<DVec3> = (0..900).map(|n| at(f64::from(n) / 900.0) + DVec3::Y * f64::from(n % 7) / 7.0).collect();
    let centers: Vec<DVec3> = (0..90).map(|n| 4.0 * at(f64::from(n) / 90.0)).collect();
    let sees = |center: &DVec3| {
        let near = (0..900).filter(|n| points[*n as usize].angle_between(*center) < 0.7);
        near.collect::<Vec<u32>>()
    };
    let visible: Vec<Vec<u32>> = centers.iter().map(sees).collect();
    let poses: Vec<Pose> = centers.iter().map(|center| Pose::new(DMat3::IDENTITY, -*center)).collect();
    let cloud = PointCloud {
        positions: points.iter().map(|point| point.as_vec3().to_array()).collect(),
        colors: vec![[0; 3]; points.len()],
    };
    let chosen = best_photos(&poses, &cloud, &visible, 24);
    assert_eq!(chosen.len(), 24);
    let beside = |n: usize| chosen.iter().filter(|m| **m != n && (m.abs_diff(n).min(90 - m.abs_diff(n))) <= 4).count();
    assert!(chosen.iter().all(|n| beside(*n) >= 2), "{chosen:?} have no neighbors");
    let seen_twice = |point: u32| chosen.iter().filter(|n| visible[**n].contains(&point)).count() >= 2;
    let shown = (0..900).filter(|point| seen_twice(*point)).count();
    assert!(shown > 600, "{shown} points of 900 are shown");
    // All are taken where all are asked for.
    assert_eq!(best_photos(&poses, &cloud, &visible, 90).len(), 90);
}
