//! Pairs of photos that show the same things, and their relative poses.

use crate::features::Features;
use crate::lenses::Taken;
use crate::matching::{Match, matches};
use crate::photo::EstimateOptions;
use crate::retrieval::candidates;
use crate::tracks::{Track, joined};
use crate::two_view::{TwoView, judge, rotation_only, turns, two_view};
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Camera, Pose};
use weaver_kernels::parallel;

/// The clearest matches, from which a pose is found; all of them judge it.
const CLEAREST: usize = 200;
/// The share of matches from which on a pure rotation explains a pair.
const TURNED: f64 = 0.95;
/// Matches of a pair that is certain.
const CERTAIN: usize = 20;
/// Fewer matches than this may be chance.
const FEWEST: usize = 12;

/// Links keypoints that pairs match.
pub(crate) fn linked(features: &[Features], pairs: &[Pair]) -> Vec<Track> {
    let counts: Vec<usize> = features.iter().map(|f| f.keypoints.len()).collect();
    joined(&counts, pairs.iter().map(|pair| (pair.photos, &pair.matches[..])))
}

/// Rigs of a sequence whose photos of the same side are compared: so many behind each.
const RIGS: [usize; 4] = [1, 2, 4, 8];

/// Pairs of photos that are compared. Photos of one rig are not: from one place nothing tells a depth.
pub(crate) fn compared(
    features: &[Features],
    taken: &[Taken],
    present: &[bool],
    settings: &EstimateOptions,
) -> Vec<[usize; 2]> {
    let EstimateOptions { candidates: most, sequence, .. } = *settings;
    let first = |photo: usize| taken[photo].mounted.map(|mounted| mounted.on);
    if taken.iter().all(|taken| taken.mounted.is_none()) {
        return candidates(features, present, most, sequence);
    }
    // Half as many of each side, since a rig has several.
    let mut pairs = candidates(features, present, most.div_ceil(2), false);
    if sequence {
        let mut firsts: Vec<usize> = (0..taken.len()).filter(|photo| first(*photo) == Some(*photo)).collect();
        firsts.dedup();
        for photo in (0..taken.len()).filter(|photo| first(*photo).is_some()) {
            let on = first(photo).unwrap_or(photo);
            let rig = firsts.partition_point(|first| *first < on);
            let behind = RIGS.iter().filter_map(|step| firsts.get(rig + step)).map(|other| other + photo - on);
            pairs.extend(behind.filter(|other| *other < taken.len()).map(|other| [photo, other]));
        }
        pairs.sort_unstable();
        pairs.dedup();
    }
    pairs.retain(|[a, b]| first(*a).is_none() || first(*a) != first(*b));
    pairs
}

/// Matches of each pair of photos that has enough.
pub(crate) fn matched(features: &[Features], candidates: &[[usize; 2]]) -> Vec<([usize; 2], Vec<Match>)> {
    let mut found: Vec<([usize; 2], Vec<Match>)> = candidates.iter().map(|pair| (*pair, Vec::new())).collect();
    parallel::for_chunks(&mut found, 1, |_, found| {
        for ([a, b], found) in found {
            *found = matches(&features[*a], &features[*b]);
        }
    });
    found.retain(|(_, found)| found.len() >= FEWEST);
    found
}

/// Evidence of pairs of photos.
#[derive(Clone, Debug, Default)]
pub(crate) struct Pairs {
    /// Matched pairs of photos, with their matches.
    pub matched: Vec<([usize; 2], Vec<Match>)>,
    /// Relative poses of pairs.
    pub posed: Vec<Pair>,
}

impl Pairs {
    /// The same with the photos numbered by `numbers`, ascending.
    pub fn renumbered(mut self, numbers: &[usize]) -> Self {
        self.matched.iter_mut().for_each(|(photos, _)| *photos = photos.map(|p| numbers[p]));
        self.posed.iter_mut().for_each(|pair| pair.photos = pair.photos.map(|p| numbers[p]));
        self
    }
}

/// Two photos with their relative pose.
#[derive(Clone, Debug)]
pub(crate) struct Pair {
    pub photos: [usize; 2],
    /// The matches that agree with the pose.
    pub matches: Vec<Match>,
    /// The pose of the second camera relative to the first, a unit apart.
    pub pose: Pose,
    /// Another pose that explains nearly as much.
    pub rival: Option<Pose>,
    /// The inverse depth of each match in the first camera.
    pub inverse_depths: Vec<f64>,
    /// Median angle between rays, radians.
    pub parallax: f64,
    pub score: f64,
    /// The share of matches that a pure rotation explains.
    pub turned: f64,
    /// The share of the candidate matches that agrees with the pose.
    pub share: f64,
}

impl Pair {
    /// True if a pure rotation explains nearly all: depths are then undetermined.
    pub fn turned(&self) -> bool {
        self.turned > TURNED
    }

    /// True if enough matches, and this share of them, agree with the pose that it is not chance: among repeated
    /// patterns and many photos some pairs are.
    pub fn certain(&self, share: f64) -> bool {
        self.matches.len() >= CERTAIN && self.share >= share
    }
}

/// The relative poses of pairs; only the intrinsics of the cameras are used. `tau` is the exactness of keypoints,
/// pixels.
pub(crate) fn posed<'a>(
    features: &[Features],
    cameras: &[Camera],
    matched: impl IntoIterator<Item = &'a ([usize; 2], Vec<Match>)>,
    tau: f64,
) -> Vec<Pair> {
    let matched: Vec<&([usize; 2], Vec<Match>)> = matched.into_iter().collect();
    let mut pairs: Vec<Option<Pair>> = vec![None; matched.len()];
    parallel::for_chunks(&mut pairs, 1, |i, pair| pair[0] = pose(features, cameras, matched[i], tau));
    pairs.into_iter().flatten().collect()
}

fn pose(
    features: &[Features],
    cameras: &[Camera],
    (photos, found): &([usize; 2], Vec<Match>),
    tau: f64,
) -> Option<Pair> {
    let [a, b] = *photos;
    let ray = |photo: usize, keypoint: usize| -> DVec2 {
        cameras[photo].intrinsics.unproject(features[photo].keypoints[keypoint].pixel, 1.0).truncate()
    };
    let rays: Vec<[DVec2; 2]> =
        (found.iter().map(Match::numbers)).map(|[first, second]| [ray(a, first), ray(b, second)]).collect();
    let tau = tau * 2.0 / (cameras[a].intrinsics.fx + cameras[b].intrinsics.fx);
    let apart = two_view(&rays[..rays.len().min(CLEAREST)], tau).and_then(|TwoView { pose, rival, .. }| {
        let TwoView { pose, inliers, depths, score, parallax, .. } = judge(pose, &rays, tau)?;
        let kept: Vec<usize> = (0..found.len()).filter(|i| inliers[*i] && depths[*i] > 0.0).collect();
        let fitting: Vec<[DVec2; 2]> = kept.iter().map(|i| rays[*i]).collect();
        (kept.len() >= FEWEST).then(|| Pair {
            photos: *photos,
            matches: kept.iter().map(|i| found[*i]).collect(),
            pose,
            rival,
            inverse_depths: kept.iter().map(|i| depths[*i]).collect(),
            parallax,
            score,
            turned: rotation_only(&fitting, tau).1 as f64 / fitting.len() as f64,
            share: kept.len() as f64 / found.len() as f64,
        })
    });
    apart.or_else(|| turned(*photos, found, &rays, tau))
}

/// Two photos whose matches a pure rotation mostly explains. Copies of one photo have no depths, so that no pose has
/// points in front.
fn turned(photos: [usize; 2], found: &[Match], rays: &[[DVec2; 2]], tau: f64) -> Option<Pair> {
    let (rotation, explained) = rotation_only(rays, tau);
    if explained < FEWEST || 2 * explained < found.len() {
        return None;
    }
    let agrees = |(_, rays): &(&Match, &[DVec2; 2])| turns(&rotation, rays, tau);
    let matches: Vec<Match> = found.iter().zip(rays).filter(agrees).map(|(found, _)| *found).collect();
    Some(Pair {
        photos,
        pose: Pose::new(rotation, DVec3::X),
        rival: None,
        inverse_depths: vec![0.0; matches.len()],
        parallax: 0.0,
        score: 0.0,
        turned: 1.0,
        share: matches.len() as f64 / found.len() as f64,
        matches,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::Keypoint;
    use weaver_geometry::{Intrinsics, so3};

    /// Two photos, the second with the keypoints of the first after a rotation; one match in `wrong` is none.
    fn pair(angle: f64, wrong: usize) -> Option<Pair> {
        let intrinsics = Intrinsics { fx: 170.0, fy: 170.0, cx: 96.0, cy: 72.0 };
        let camera = Camera { pose: Pose::IDENTITY, intrinsics, width: 192, height: 144 };
        let turn = so3::exp(DVec3::Y * angle);
        let keypoint = |pixel: DVec2| Keypoint { pixel, scale: 1.0, angle: 0.0, contrast: 1.0 };
        let features = |of: &dyn Fn(usize, DVec2) -> DVec2| {
            let at = |i: usize| DVec2::new(20.0 + (i * 37 % 150) as f64, 15.0 + (i * 53 % 113) as f64);
            Features { keypoints: (0..80).map(|i| keypoint(of(i, at(i)))).collect(), descriptors: Vec::new() }
        };
        let first = features(&|_, at| at);
        let second = features(&|i, at| match i % wrong {
            0 => DVec2::new(20.0 + (i * 71 % 150) as f64, 15.0 + (i * 29 % 113) as f64),
            _ => intrinsics.project(turn * intrinsics.unproject(at, 1.0)),
        });
        let found = (0..80).map(|i| Match { first: i, second: i, ratio: 0.5 }).collect();
        posed(&[first, second], &[camera; 2], &[([0, 1], found)], 0.5).pop()
    }

    #[test]
    fn copies_and_turns_are_pairs_of_one_place() {
        for (angle, wrong) in [(0.0, 1000), (0.0, 5), (0.1, 1000), (0.1, 5)] {
            let pair = pair(angle, wrong).unwrap_or_else(|| panic!("no pair of {angle} rad, 1 in {wrong} wrong"));
            let forward = pair.pose.rotation * DVec3::Z;
            assert!(pair.turned() && (forward.x - angle.sin()).abs() < 1e-3, "{angle}: {pair:?}");
            assert!(pair.matches.len() >= 20 && pair.matches.len() == pair.inverse_depths.len());
        }
        // A pose that some agree with by chance, but no turn.
        assert!(pair(0.1, 1).is_none_or(|pair| !pair.turned()));
    }
}
