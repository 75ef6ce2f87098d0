//! Many photos of points on a ball, compared with the search for few photos and with the truth.

use super::*;
use crate::features::{Features, Keypoint};
use crate::lenses::Taken;
use crate::matching::Match;
use crate::photo::{EstimateOptions, Photo};
use rayon::ThreadPoolBuilder;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Intrinsics, Pose, Similarity};
use weaver_kernels::random::Stream;

const PHOTOS: usize = 48;
const POINTS: usize = 700;
const SIZE: [usize; 2] = [288, 384];
const FOCAL: f64 = 400.0;
/// Distance of cameras from the middle of the ball, whose radius is 1.
const AWAY: f64 = 3.5;

/// A way around the ball, up and down.
fn truth() -> Vec<Pose> {
    let pose = |i: usize| {
        let angle = std::f64::consts::TAU * i as f64 / PHOTOS as f64;
        let center = DVec3::new(angle.cos(), 0.3 * (3.0 * angle).sin(), angle.sin()) * AWAY;
        let z = -center.normalize();
        let x = DVec3::Y.cross(z).normalize();
        let rotation = DMat3::from_cols(x, z.cross(x), z).transpose();
        Pose::new(rotation, -(rotation * center))
    };
    (0..PHOTOS).map(pose).collect()
}

/// Features of each photo: the points that face it, a third of a pixel off.
fn features() -> Vec<Features> {
    let stream = Stream::new(5, 0, "test.ball");
    let normal = |k: usize| stream.normal(k as u64);
    let direction = |k: usize| DVec3::new(normal(k), normal(k + 1), normal(k + 2)).normalize();
    let of_point = |point: usize, photo: usize| -> Vec<u8> {
        let value = |k: usize| {
            let own = normal(10_000 + 128 * point + k).abs();
            (own + 0.1 * normal(200_000 + 128 * (POINTS * photo + point) + k)).max(0.0)
        };
        let values: Vec<f64> = (0..128).map(value).collect();
        let length = values.iter().map(|v| v * v).sum::<f64>().sqrt();
        values.iter().map(|v| (v / length * 250.0).round().min(127.0) as u8).collect()
    };
    let intrinsics = Intrinsics { fx: FOCAL, fy: FOCAL, cx: SIZE[1] as f64 / 2.0, cy: SIZE[0] as f64 / 2.0 };
    let photo = |(photo, pose): (usize, Pose)| {
        let mut features = Features::default();
        for point in 0..POINTS {
            let at = direction(3 * point);
            if at.dot((pose.center() - at).normalize()) < 0.4 {
                continue;
            }
            let noise = direction(5000 + 3 * (POINTS * photo + point)).truncate() / 3.0;
            let pixel = intrinsics.project(pose.apply(at)) + noise;
            features.keypoints.push(Keypoint { pixel, scale: 1.0, angle: 0.0, contrast: 1.0 });
            features.descriptors.extend(of_point(point, photo));
        }
        features
    };
    truth().into_iter().enumerate().map(photo).collect()
}

/// The best scene that a way to search finds.
fn found(features: &[Features], run: impl Fn(&mut Search<'_>)) -> Grown {
    let taken = vec![Taken { size: SIZE, focal: Some(FOCAL), lens: 0, mounted: None }; PHOTOS];
    let settings = EstimateOptions::default();
    // Observations are drawn, so nothing is looked up in photos.
    let blank = Photo::new(vec![0; 3 * SIZE[0] * SIZE[1]], SIZE);
    let photos = vec![&blank; PHOTOS];
    let mut search = Search::new(&taken, &photos, features, &settings);
    run(&mut search);
    search.found.into_iter().max_by(|a, b| a.value().partial_cmp(&b.value()).expect("numbers")).expect("a scene")
}

/// The largest difference of rotations, radians, and of centers, after the best similarity.
fn apart(found: &Grown, truth: &[Pose]) -> [f64; 2] {
    let poses: Vec<Pose> = found.bundle.cameras.iter().map(|c| c.pose).collect();
    let onto = Similarity::fit_poses(&poses, truth).expect("cameras");
    let moved = poses.iter().map(|pose| onto.apply_to_pose(pose)).zip(truth);
    moved.fold([0.0, 0.0], |[turn, far], (a, b)| [turn.max(a.angle_to(b)), far.max(a.center().distance(b.center()))])
}

/// Promise (figures): hundreds of photos come to the cameras that a few do, at any number of threads.
#[test]
fn many_photos_have_the_cameras_that_they_have_as_few() {
    let features = features();
    let truth = truth();
    let few = found(&features, |search| search.run());
    let many = found(&features, |search| search.run_many());
    for grown in [&few, &many] {
        assert!(grown.placed.iter().all(|placed| *placed), "{:?}", grown.value());
        let [turn, far] = apart(grown, &truth);
        assert!(turn < 0.003 && far < 0.01, "{turn} radians and {far} off");
    }
    let poses: Vec<Pose> = few.bundle.cameras.iter().map(|c| c.pose).collect();
    let [turn, far] = apart(&many, &poses);
    assert!(turn < 0.001 && far < 0.004, "{turn} radians and {far} apart");
}

/// Promise of `many_photos_have_the_cameras_that_they_have_as_few`.
#[test]
fn the_same_bits_at_any_number_of_threads() {
    let features = features();
    let with = |threads: usize| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let grown = pool.install(|| found(&features, |search| search.run_many()));
        let numbers =
            |pose: Pose| [pose.translation.to_array(), pose.rotation.x_axis.to_array()].map(|v| v.map(f64::to_bits));
        grown.bundle.cameras.iter().map(|c| numbers(c.pose)).collect::<Vec<_>>()
    };
    assert_eq!(with(1), with(3));
}

/// Pairs that have less in common than neighbors come later.
#[test]
fn pairs_with_little_in_common_come_later() {
    let pair = |photos, count: usize, share| {
        let matches = vec![Match { first: 0, second: 0, ratio: 0.5 }; count];
        let pose = Pose::IDENTITY;
        let inverse_depths = vec![1.0; count];
        Pair { photos, matches, pose, rival: None, inverse_depths, parallax: 0.1, score: 1.0, turned: 0.0, share }
    };
    // The last photo has no better pair than the one with the first.
    let pairs = [([0, 3], 30, 0.4), ([0, 2], 25, 0.9), ([1, 3], 40, 0.55), ([0, 1], 100, 0.9), ([1, 2], 60, 0.7)];
    let pairs = pairs.map(|(photos, count, share)| pair(photos, count, share)).to_vec();
    let ranked = Ranked::new([pairs, vec![pair([0, 4], 25, 0.7)]].concat(), 5);
    let order: Vec<[usize; 2]> = ranked.pairs.iter().map(|pair| pair.photos).collect();
    assert_eq!(order, [[0, 1], [1, 2], [0, 4], [0, 2], [1, 3], [0, 3]]);
    assert_eq!(ranked.ends, [3, 4, 5]);
}
