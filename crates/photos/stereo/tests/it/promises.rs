//! Promises of the crate.

use crate::planted::{NORMAL, Planted, inverse_depth, wall};
use std::sync::LazyLock;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_scene::PointCloud;
use weaver_stereo::{Stereo, StereoSettings};

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
    let missing = STEREO.unexplained().len();
    assert!(missing < 30, "{missing} points of 300 are not shown");
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
