//! Keypoints: where they are found, and found again.

use weaver_geometry::glam::DVec2;
use weaver_kernels::random::Stream;
use weaver_sfm::{Features, matches};

/// A photo of one round spot.
fn spot(at: DVec2, sigma: f64, size: [usize; 2]) -> Vec<f32> {
    let [height, width] = size;
    let value = |i: usize| {
        let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        (0.2 + 0.6 * (-0.5 * pixel.distance_squared(at) / (sigma * sigma)).exp()) as f32
    };
    (0..width * height).map(value).collect()
}

#[test]
fn spots_are_found_where_they_are() {
    for (width, height) in [(64, 48), (192, 160), (384, 256), (600, 400)] {
        for (i, sigma) in [1.5, 2.5, 4.0, 6.0].into_iter().enumerate() {
            let stream = Stream::new(width as u64, i as u64, "test.spots");
            let at = |k: u64, size: usize| size as f64 * (0.4 + 0.2 * stream.uniform::<f64>(k));
            let at = DVec2::new(at(0, width), at(1, height));
            let features = Features::new(&spot(at, sigma, [height, width]), [height, width], None, 10);
            let off = features.keypoints.iter().map(|k| k.pixel.distance(at)).fold(f64::INFINITY, f64::min);
            assert!(off < 0.06 * sigma, "{width}x{height}, sigma {sigma}: off by {off}");
        }
    }
}

/// A turned, shrunk and darker photo: most of its keypoints are found again, at the right places.
#[test]
fn keypoints_are_found_again_in_a_turned_photo() {
    let texture = |p: DVec2| {
        let wave = |k: u64| {
            let stream = Stream::new(9, k, "test.waves");
            let frequency = DVec2::new(stream.normal(0), stream.normal(1)) * 0.18;
            (frequency.dot(p) + 6.0 * stream.uniform::<f64>(2)).sin()
        };
        0.5 + 0.05 * (0..14).map(wave).sum::<f64>()
    };
    let (width, height) = (240, 200);
    let center = DVec2::new(120.0, 100.0);
    let turn = DVec2::from_angle(0.6);
    let there = |p: DVec2| turn.rotate(p - center) * 1.25 + center;
    let photo = |of: &dyn Fn(DVec2) -> f64| -> Features {
        let gray: Vec<f32> = (0..width * height)
            .map(|i| of(DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5)) as f32)
            .collect();
        Features::new(&gray, [height, width], None, 400)
    };
    let (first, second) = (photo(&texture), photo(&|p| 0.1 + 0.7 * texture(there(p))));
    let found = matches(&second, &first);
    let right =
        found.iter().filter(|m| there(second.keypoints[m.first].pixel).distance(first.keypoints[m.second].pixel) < 1.0);
    let right = right.count();
    assert!(right > 40 && 20 * right > 19 * found.len(), "{right} of {} matches are right", found.len());
}

#[test]
fn masked_and_empty_photos_have_no_keypoints() {
    let size = [48, 64];
    let photo = spot(DVec2::new(20.0, 20.0), 3.0, size);
    let mask = vec![0; photo.len()];
    assert!(Features::new(&photo, size, Some(&mask), 100).keypoints.is_empty());
    assert!(Features::new(&[0.5; 64 * 48], size, None, 100).keypoints.is_empty());
    assert!(Features::new(&[0.5; 12], [3, 4], None, 100).keypoints.is_empty());
    let empty = Features::default();
    assert!(matches(&empty, &Features::new(&photo, size, None, 100)).is_empty());
}
