//! Pose of a photo in a scene made by others.

mod resection;

use crate::bundle::{Bundle, Lens, Observation};
use crate::epipolar::Epipolar;
use crate::evidence::{Evidence, FITS, STEPS, Trust};
use crate::features::Features;
use crate::matching::Match;
use crate::pairs::Pair;
use crate::passes::sharpest;
use resection::{Sight, resected};
use std::cmp::Ordering;
use weaver_geometry::glam::DVec2;
use weaver_geometry::{Camera, Pose};
use weaver_kernels::order::median_high;

/// Scales of the robust loss when a camera is fitted to the points that it sees.
const LOCATING: [f64; 4] = [16.0, 8.0, 4.0, 2.0];
/// Poses that are tried for a camera: the best by points and by pairs.
const TRIED: usize = 4;
/// The share of its matches with placed photos that must agree with a pose.
const ENOUGH: f64 = 0.35;

/// The order in which the observations of a photo are looked up.
pub(crate) fn by_pixel(a: DVec2, b: DVec2) -> Ordering {
    a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y))
}

/// A place for a photo.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub pose: Pose,
    /// Inlier count of points, or of matches.
    pub count: usize,
    /// The share of the photo's matches with placed ones that agree with it.
    pub share: f64,
}

/// The pose of a photo that stands alone or leads its rig, and the inlier count of all of it: of points or, if it sees
/// too few, of matches with placed photos. The observations `seen` of each photo are in the order of pixels.
pub(crate) fn place(
    evidence: &Evidence<'_>,
    bundle: &Bundle,
    placed: &[bool],
    seen: &[Vec<Observation>],
    photo: usize,
) -> Option<Place> {
    let (mut turned, mut apart) = (Vec::new(), Vec::new());
    let rig = bundle.together(photo);
    for pair in evidence.pairs {
        for (this, other) in [(pair.photos[0], pair.photos[1]), (pair.photos[1], pair.photos[0])] {
            if rig.contains(&this) && placed[other] {
                let (turn, far) = suggested(bundle, &seen[other], evidence, pair, this);
                turned.push(bundle.pose_of_first(this, turn));
                apart.extend(far.map(|far| bundle.pose_of_first(this, far)));
            }
        }
    }
    let points: usize = seen[rig].iter().map(Vec::len).sum();
    let Trust { fewest, share, matches_alone } = evidence.trust;
    let enough = |count: usize| count >= fewest && count as f64 >= share * points as f64;
    let with_share = |(pose, count): (Pose, usize)| {
        let [agree, all] = tally(evidence, bundle, placed, &pose, photo);
        Place { pose, count, share: agree as f64 / all.max(1) as f64 }
    };
    let of_matches = || by_matches(evidence, bundle, placed, &apart, photo).filter(|_| matches_alone).map(with_share);
    by_points(bundle, seen, &[&apart[..], &turned].concat(), photo)
        .filter(|(_, count)| enough(*count))
        .map(with_share)
        .filter(|place| place.share >= ENOUGH)
        .or_else(of_matches)
}

/// The candidate that fits the points best, adjusted to them.
fn by_points(bundle: &Bundle, seen: &[Vec<Observation>], suggestions: &[Pose], photo: usize) -> Option<(Pose, usize)> {
    let Lens { k1, k2, .. } = bundle.lenses[bundle.lens_of[photo]];
    let lens = Lens { k1, k2, ..Lens::default() };
    let rig: Vec<usize> = bundle.together(photo).collect();
    let seen = || rig.iter().enumerate().flat_map(|(camera, photo)| seen[*photo].iter().map(move |o| (camera, o)));
    let mut alone = Bundle {
        cameras: rig.iter().map(|photo| bundle.camera(*photo)).collect(),
        lenses: vec![lens],
        lens_of: vec![0; rig.len()],
        rig: bundle.rig_of(&rig),
        fixed: vec![false; rig.len()],
        points: seen().map(|(_, o)| bundle.points[o.point]).collect(),
        fixed_points: true,
        observations: seen().enumerate().map(|(point, (camera, o))| Observation { camera, point, ..*o }).collect(),
        ..Bundle::default()
    };
    let sight = |(camera, o): (usize, &Observation)| {
        let (point, within) = (bundle.points[o.point], FITS * o.deviation);
        Sight { point, camera, pixel: o.pixel, within }
    };
    let sights: Vec<Sight> = seen().map(sight).collect();
    let resected = resected(&sights, &alone);
    let mut tried: Vec<(f64, Pose)> = Vec::new();
    for pose in resected.iter().chain(suggestions) {
        alone.put(0, *pose);
        tried.push((fitting(&alone, LOCATING[0]).0, *pose));
    }
    tried.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut best: Option<(f64, Pose, usize)> = None;
    for (_, pose) in tried.into_iter().take(TRIED) {
        alone.put(0, pose);
        LOCATING.iter().for_each(|scale| alone.adjust_roughly(*scale, 2 * STEPS));
        let (value, count) = fitting(&alone, FITS);
        if best.is_none_or(|best| value > best.0) {
            best = Some((value, alone.cameras[0].pose, count));
        }
    }
    best.map(|(_, pose, count)| (pose, count))
}

/// The candidate that most matches with placed photos agree with.
fn by_matches(
    evidence: &Evidence<'_>,
    bundle: &Bundle,
    placed: &[bool],
    suggestions: &[Pose],
    photo: usize,
) -> Option<(Pose, usize)> {
    let counted = suggestions.iter().map(|pose| (*pose, tally(evidence, bundle, placed, pose, photo)[0]));
    let best = counted.max_by_key(|(_, count)| *count)?;
    (best.1 >= evidence.trust.fewest).then_some(best)
}

/// Number of matches with placed photos that agree with the pose of a photo that leads its rig or stands alone, and of
/// all.
pub(crate) fn tally(
    evidence: &Evidence<'_>,
    bundle: &Bundle,
    placed: &[bool],
    pose: &Pose,
    photo: usize,
) -> [usize; 2] {
    let rig = bundle.together(photo);
    let here = |i: usize| Camera { pose: bundle.pose_by_first(i, pose), ..bundle.camera(i) };
    let camera = |i: usize| if rig.contains(&i) { here(i) } else { bundle.camera(i) };
    let with = |pair: &&Pair| {
        let [a, b] = pair.photos;
        rig.contains(&a) && placed[b] || rig.contains(&b) && placed[a]
    };
    evidence.pairs.iter().filter(with).fold([0, 0], |[agree, all], pair| {
        [agree + agreeing(evidence.features, pair, &pair.photos.map(camera)), all + pair.matches.len()]
    })
}

/// Sum of the weights of fitting observations, and their number.
fn fitting(bundle: &Bundle, within: f64) -> (f64, usize) {
    bundle.fits(within).into_iter().fold((0.0, 0), |(sum, count), x| (sum + x, count + usize::from(x > 0.0)))
}

/// Poses of a camera by a pair with a placed one: at the same place, and at the distance by points that the other sees.
fn suggested(
    bundle: &Bundle,
    seen_by_other: &[Observation],
    evidence: &Evidence<'_>,
    pair: &Pair,
    photo: usize,
) -> (Pose, Option<Pose>) {
    let second = pair.photos[1] == photo;
    let other = pair.photos[usize::from(!second)];
    let camera: &Camera = &bundle.cameras[other];
    let mut ratios = Vec::new();
    for (m, inverse_depth) in pair.matches.iter().zip(&pair.inverse_depths) {
        let [of_first, of_second] = m.numbers();
        let keypoint = if second { of_first } else { of_second };
        let pixel = evidence.features[other].keypoints[keypoint].pixel;
        let first = seen_by_other.partition_point(|o| by_pixel(o.pixel, pixel).is_lt());
        let Some(o) = seen_by_other.get(first).filter(|o| o.pixel == pixel) else { continue };
        let depth = camera.pose.apply(bundle.points[o.point]).z;
        let here = if second {
            1.0 / inverse_depth
        } else {
            let first = bundle.cameras[photo]
                .intrinsics
                .unproject(evidence.features[photo].keypoints[of_first].pixel, 1.0 / inverse_depth);
            pair.pose.apply(first).z
        };
        ratios.push(depth / here);
    }
    ratios.retain(|r| r.is_finite() && *r > 0.0);
    let across = if second { pair.pose } else { pair.pose.inverse() };
    let with = |scale: f64| Pose::new(across.rotation, across.translation * scale).compose(&camera.pose);
    (with(0.0), median_high(&mut ratios).map(with))
}

/// Number of matches of a pair that lie on the epipolar lines of two cameras.
pub(crate) fn agreeing(features: &[Features], pair: &Pair, [first, second]: &[Camera; 2]) -> usize {
    let [a, b] = pair.photos.map(|photo| &features[photo].keypoints);
    let epipolar = Epipolar::new(first, second, FITS * sharpest(second));
    let numbers = pair.matches.iter().map(Match::numbers);
    numbers.filter(|[first, second]| epipolar.allows(a[*first].pixel, b[*second].pixel)).count()
}
