//! Which photos show the same things, and how two that do stand to each other.

use crate::features::Features;
use crate::matching::{Match, matches};
use crate::tracks::{Track, joined};
use crate::two_view::{TwoView, judge, rotation_only, two_view};
use weaver_geometry::glam::DVec2;
use weaver_geometry::{Camera, Pose};
use weaver_kernels::parallel;

/// Matches, the clearest, from which a pose is found; it is judged by all.
const CLEAREST: usize = 200;
/// The share of matches from which on a mere turn explains a pair.
const TURNED: f64 = 0.95;
/// Matches of a pair that is certain.
const CERTAIN: usize = 20;
/// Fewer matches than this may be chance.
const FEWEST: usize = 12;

/// What pairs say to be the same.
pub(crate) fn linked(features: &[Features], pairs: &[Pair]) -> Vec<Track> {
    let counts: Vec<usize> = features.iter().map(|f| f.keypoints.len()).collect();
    joined(&counts, pairs.iter().map(|pair| (pair.photos, &pair.matches[..])))
}

/// What matches in each pair of photos, where enough does.
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

/// What pairs of photos say.
#[derive(Clone, Debug, Default)]
pub(crate) struct Pairs {
    /// What looks alike in them.
    pub matched: Vec<([usize; 2], Vec<Match>)>,
    /// How they stand to each other.
    pub posed: Vec<Pair>,
}

impl Pairs {
    /// The same, where the photos have these numbers, ascending.
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
    /// The share of matches that a mere turn explains.
    pub turned: f64,
    /// The share of what looked alike that agrees with the pose.
    pub share: f64,
}

impl Pair {
    /// Whether a mere turn explains nearly all: how far anything is away is then unknown.
    pub fn turned(&self) -> bool {
        self.turned > TURNED
    }

    /// Whether enough matches, and such a share of them, agree with the pose that it is not chance: repeated patterns and many photos make some pairs that are.
    pub fn certain(&self, share: f64) -> bool {
        self.matches.len() >= CERTAIN && self.share >= share
    }
}

/// The relative poses of pairs, for cameras of which only the intrinsics count; `tau` is how exact keypoints are, pixels.
pub(crate) fn posed(
    features: &[Features],
    cameras: &[Camera],
    matched: &[([usize; 2], Vec<Match>)],
    tau: f64,
) -> Vec<Pair> {
    let mut pairs: Vec<Option<Pair>> = vec![None; matched.len()];
    parallel::for_chunks(&mut pairs, 1, |i, pair| pair[0] = pose(features, cameras, &matched[i], tau));
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
    let rays: Vec<[DVec2; 2]> = found.iter().map(|m| [ray(a, m.first), ray(b, m.second)]).collect();
    let tau = tau * 2.0 / (cameras[a].intrinsics.fx + cameras[b].intrinsics.fx);
    let clearest = &rays[..rays.len().min(CLEAREST)];
    let TwoView { pose, rival, .. } = two_view(clearest, tau)?;
    let TwoView { pose, inliers, depths, score, parallax, .. } = judge(pose, &rays, tau)?;
    let fits = |i: &usize| inliers[*i] && depths[*i] > 0.0;
    let kept: Vec<usize> = (0..found.len()).filter(fits).collect();
    let fitting: Vec<[DVec2; 2]> = kept.iter().map(|i| rays[*i]).collect();
    let turned = rotation_only(&fitting, tau).1 as f64 / fitting.len().max(1) as f64;
    (kept.len() >= FEWEST).then(|| Pair {
        photos: *photos,
        matches: kept.iter().map(|i| found[*i]).collect(),
        pose,
        rival,
        inverse_depths: kept.iter().map(|i| depths[*i]).collect(),
        parallax,
        score,
        turned,
        share: kept.len() as f64 / found.len() as f64,
    })
}
