//! Photos that were taken by rotating on the spot.

use crate::bundle::Bundle;
use crate::features::Features;
use crate::matching::Match;
use crate::pairs::Pair;
use crate::two_view::rotation_only;
use weaver_geometry::glam::DVec2;
use weaver_kernels::parallel;

/// The share of matches from which on pure rotations explain a whole set of photos.
const NEARLY_ALL: f64 = 0.9;
/// The clearest matches of a pair, which count.
const CLEAREST: usize = 200;

/// True if the photos with a place were taken by rotating on the spot: a rotation of each pair alone explains nearly
/// all matches between them, so that centers and points follow from errors of matching.
///
/// A plane gives a homography, too, but not a rotation unless its camera stays. All pairs count, as neighbors may stand
/// nearly still in photos that are far apart otherwise. `tau` is the exactness of keypoints, pixels.
///
/// Source: Hartley & Zisserman, Multiple View Geometry in Computer Vision, 2004, section 13.1.
pub(crate) fn turning(features: &[Features], pairs: &[Pair], bundle: &Bundle, placed: &[bool], tau: f64) -> bool {
    let of_placed: Vec<&Pair> = pairs.iter().filter(|pair| pair.photos.iter().all(|photo| placed[*photo])).collect();
    let mut counts = vec![[0_usize; 2]; of_placed.len()];
    parallel::for_chunks(&mut counts, 1, |i, count| count[0] = turned(features, of_placed[i], bundle, tau));
    let [turned, all] = counts.iter().fold([0, 0], |[turned, all], count| [turned + count[0], all + count[1]]);
    all > 0 && turned as f64 > NEARLY_ALL * all as f64
}

/// Number of matches of a pair that a pure rotation explains, and of all.
fn turned(features: &[Features], pair: &Pair, bundle: &Bundle, tau: f64) -> [usize; 2] {
    let cameras = pair.photos.map(|photo| bundle.camera(photo));
    let ray = |side: usize, keypoint: usize| -> DVec2 {
        let photo = pair.photos[side];
        let lens = &bundle.lenses[bundle.lens_of[photo]];
        let pixel = lens.undistort(&bundle.cameras[photo], features[photo].keypoints[keypoint].pixel);
        cameras[side].intrinsics.unproject(pixel, 1.0).truncate()
    };
    let clearest = pair.matches.iter().take(CLEAREST).map(Match::numbers);
    let rays: Vec<[DVec2; 2]> = clearest.map(|[first, second]| [ray(0, first), ray(1, second)]).collect();
    let tau = tau * 2.0 / (cameras[0].intrinsics.fx + cameras[1].intrinsics.fx);
    [rotation_only(&rays, tau).1, rays.len()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::Lens;
    use crate::features::Keypoint;
    use weaver_geometry::glam::DVec3;
    use weaver_geometry::{Camera, Intrinsics, Pose, so3};
    use weaver_kernels::random::Stream;

    const PHOTOS: usize = 4;
    const POINTS: usize = 60;

    /// Photos of points at all depths, whose cameras are turned and stand so far apart, and all pairs of them.
    fn photos(apart: f64, wrong: usize) -> (Vec<Features>, Vec<Pair>, Bundle) {
        let stream = Stream::new(4, 0, "test.turning");
        let point = |i: usize| {
            let [x, y, depth] = [0, 1, 2].map(|k| stream.uniform::<f64>((3 * i + k) as u64));
            DVec3::new(x - 0.5, y - 0.5, 1.0) * (2.0 + 6.0 * depth)
        };
        let intrinsics = Intrinsics { fx: 300.0, fy: 300.0, cx: 160.0, cy: 120.0 };
        let camera = |i: usize| {
            let rotation = so3::exp(DVec3::new(0.02, 0.08, -0.03) * i as f64);
            let center = DVec3::new(i as f64, 0.3 * i as f64, 0.0) * apart;
            Camera { pose: Pose::new(rotation, -(rotation * center)), intrinsics, width: 320, height: 240 }
        };
        let cameras: Vec<Camera> = (0..PHOTOS).map(camera).collect();
        let features = |(photo, camera): (usize, &Camera)| {
            let keypoint = |i: usize| {
                let off = if i < wrong { DVec2::splat(40.0 * photo as f64) } else { DVec2::ZERO };
                let pixel = intrinsics.project(camera.pose.apply(point(i))) + off;
                Keypoint { pixel, scale: 1.0, angle: 0.0, contrast: 1.0 }
            };
            Features { keypoints: (0..POINTS).map(keypoint).collect(), descriptors: Vec::new() }
        };
        let features = cameras.iter().enumerate().map(features).collect();
        let pair = |photos: [usize; 2]| Pair {
            photos,
            matches: (0..POINTS as u32).map(|i| Match { first: i, second: i, ratio: 0.5 }).collect(),
            pose: Pose::IDENTITY,
            rival: None,
            inverse_depths: vec![1.0; POINTS],
            parallax: 0.1,
            score: 1.0,
            turned: 0.0,
            share: 1.0,
        };
        let pairs = (0..PHOTOS).flat_map(|b| (0..b).map(move |a| [a, b])).map(pair).collect();
        let bundle = Bundle { cameras, lenses: vec![Lens::default()], lens_of: vec![0; PHOTOS], ..Bundle::default() };
        (features, pairs, bundle)
    }

    #[test]
    fn turns_on_the_spot_are_told_from_steps_aside() {
        for (apart, wrong, expected) in [(0.0, 0, true), (0.0, 3, true), (0.0, 15, false), (0.2, 0, false)] {
            let (features, pairs, bundle) = photos(apart, wrong);
            let found = turning(&features, &pairs, &bundle, &[true; PHOTOS], 1.0);
            assert_eq!(found, expected, "{apart} apart, {wrong} wrong matches");
        }
    }

    /// Photos without a place say nothing, and no pair is no evidence.
    #[test]
    fn only_photos_with_a_place_count() {
        let (features, pairs, bundle) = photos(0.0, 0);
        assert!(turning(&features, &pairs, &bundle, &[true, true, false, false], 1.0));
        assert!(!turning(&features, &pairs, &bundle, &[true, false, false, false], 1.0));
    }
}
