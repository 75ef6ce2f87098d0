//! The second look, with a matcher that knows the scene.

use weaver_data::{Scene, View};
use weaver_geometry::Pose;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_kernels::random::Stream;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_sfm::{
    Confidence, Estimate, EstimateOptions, Features, LEARNED_DESCRIPTOR, LearnedFeatures, LearnedMatch, LeftOut,
    PairMatcher, Photo, estimate_from, estimate_with,
};

fn drawn() -> Scene {
    scene(3, &ProceduralOptions { width: 256, height: 192, views: 8 })
}

fn photos(scene: &Scene) -> Vec<Photo<'static>> {
    let photo = |view: &View| Photo {
        focal: Some(view.camera.intrinsics.fx),
        ..Photo::new(view.image.to_bytes(), [view.camera.height, view.camera.width])
    };
    scene.views.iter().map(photo).collect()
}

/// Knows where points of the first views are in all others.
struct Oracle {
    bytes: Vec<Vec<u8>>,
    features: Vec<LearnedFeatures>,
}

impl Oracle {
    fn new(scene: &Scene) -> Self {
        let mut points: Vec<DVec3> = Vec::new();
        for view in scene.views.iter().take(4) {
            let depth = view.depth.as_ref().expect("depth of a drawn view");
            for i in (0..depth.len()).step_by(97).filter(|i| depth[*i] > 0.0) {
                let pixel = DVec2::new((i % view.camera.width) as f64 + 0.5, (i / view.camera.width) as f64 + 0.5);
                let there = view.camera.intrinsics.unproject(pixel, f64::from(depth[i]));
                points.push(view.camera.pose.inverse().apply(there));
            }
        }
        let features = |view: &View| {
            let depth = view.depth.as_ref().expect("depth of a drawn view");
            let [height, width] = [view.camera.height, view.camera.width];
            let mut found = LearnedFeatures { size: [height, width], pixel: [1.0; 2], ..LearnedFeatures::default() };
            for (number, point) in points.iter().enumerate() {
                let there = view.camera.pose.apply(*point);
                let pixel = view.camera.intrinsics.project(there);
                let inside = there.z > 0.0 && pixel.x > 0.0 && pixel.y > 0.0;
                let at = (pixel.y as usize).saturating_mul(width).saturating_add(pixel.x as usize);
                let inside = inside && pixel.x < width as f64 && pixel.y < height as f64;
                if inside && (f64::from(depth[at]) / there.z - 1.0).abs() < 0.01 {
                    found.points.push([pixel.x as f32 - 0.5, pixel.y as f32 - 0.5]);
                    // The score is the number of the point, by which the matcher finds it.
                    found.scores.push(number as f32);
                    let stream = Stream::new(number as u64, 0, "test.oracle");
                    let numbers: Vec<f32> =
                        (0..LEARNED_DESCRIPTOR).map(|k| stream.uniform::<f32>(k as u64) - 0.5).collect();
                    let length = numbers.iter().map(|x| x * x).sum::<f32>().sqrt();
                    found.descriptors.extend(numbers.iter().map(|x| x / length));
                }
            }
            found
        };
        let bytes = scene.views.iter().map(|view| view.image.to_bytes()).collect();
        Self { bytes, features: scene.views.iter().map(features).collect() }
    }
}

impl PairMatcher for Oracle {
    fn features_of(&self, photo: &Photo<'_>) -> LearnedFeatures {
        let number = self.bytes.iter().position(|bytes| bytes[..] == photo.rgb[..]);
        self.features[number.expect("a photo of the scene")].clone()
    }

    fn matches_of(&self, first: &LearnedFeatures, second: &LearnedFeatures) -> Vec<LearnedMatch> {
        let same = |(i, number): (usize, &f32)| {
            let j = second.scores.iter().position(|other| other == number)?;
            Some(LearnedMatch { first: i as u32, second: j as u32, score: 0.9 })
        };
        first.scores.iter().enumerate().filter_map(same).collect()
    }
}

/// A matcher that nobody may ask.
struct Forbidden;

impl PairMatcher for Forbidden {
    fn features_of(&self, _: &Photo<'_>) -> LearnedFeatures {
        panic!("a settled capture is not looked at again");
    }

    fn matches_of(&self, _: &LearnedFeatures, _: &LearnedFeatures) -> Vec<LearnedMatch> {
        panic!("a settled capture is not looked at again");
    }
}

/// Rotation between two photos beside the one of the scene, degrees.
fn off(found: &Estimate, scene: &Scene, [a, b]: [usize; 2]) -> f64 {
    let found = [a, b].map(|i| found.cameras[i].expect("a camera").pose);
    let known = [a, b].map(|i| scene.views[i].camera.pose);
    let turn = |poses: [Pose; 2]| poses[1].relative_to(&poses[0]);
    turn(found).angle_to(&turn(known)).to_degrees()
}

/// A photo without own features is placed where it was taken; the cameras of the others stay the same to the bit.
///
/// Promise (photos): a second look places photos that own features leave out, and changes no camera of a good scene;
/// a capture that is placed and good is not looked at again.
#[test]
fn a_photo_that_is_left_out_is_registered() {
    let scene = drawn();
    let photos = photos(&scene);
    let settings = EstimateOptions { focal_deviation: 0.0, ..EstimateOptions::default() };
    let mut features: Vec<Features> = photos.iter().map(|photo| photo.features(settings.keypoints)).collect();
    let whole = estimate_from(&photos, &features, &settings);
    assert_eq!((whole.confidence(), whole.cameras.iter().flatten().count()), (Confidence::Good, 8));
    let same = estimate_with(&photos, &features, &settings, &Forbidden);
    assert_eq!((&same.cameras, &same.points), (&whole.cameras, &whole.points));

    features[3] = Features::default();
    let without = estimate_from(&photos, &features, &settings);
    assert_eq!((without.cameras[3], without.confidence()), (Err(LeftOut::Textureless), Confidence::Good));
    let with = estimate_with(&photos, &features, &settings, &Oracle::new(&scene));
    assert_eq!(with.second_look, [3]);
    for photo in (0..8).filter(|photo| *photo != 3) {
        assert_eq!(with.cameras[photo], without.cameras[photo], "{photo}");
    }
    let before = off(&without, &scene, [2, 4]);
    assert!(off(&with, &scene, [2, 3]) < 1.0 + before, "{} degrees off", off(&with, &scene, [2, 3]));
}

/// A matcher that finds nothing changes nothing.
///
/// Promise of `a_photo_that_is_left_out_is_registered`.
#[test]
fn a_matcher_that_finds_nothing_changes_nothing() {
    struct Blind;
    impl PairMatcher for Blind {
        fn features_of(&self, photo: &Photo<'_>) -> LearnedFeatures {
            LearnedFeatures { size: photo.size, ..LearnedFeatures::default() }
        }
        fn matches_of(&self, _: &LearnedFeatures, _: &LearnedFeatures) -> Vec<LearnedMatch> {
            Vec::new()
        }
    }
    let scene = drawn();
    let photos = photos(&scene);
    let settings = EstimateOptions::default();
    let mut features: Vec<Features> = photos.iter().map(|photo| photo.features(settings.keypoints)).collect();
    features[0] = Features::default();
    let without = estimate_from(&photos, &features, &settings);
    let with = estimate_with(&photos, &features, &settings, &Blind);
    assert_eq!((&with.cameras, &with.points, with.second_look.len()), (&without.cameras, &without.points, 0));
}
