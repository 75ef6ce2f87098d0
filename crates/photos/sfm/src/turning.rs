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
