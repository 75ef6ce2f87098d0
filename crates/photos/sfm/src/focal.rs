//! The focal length of photos without one, from the support of pairs at each candidate.

use crate::features::Features;
use crate::lenses::USUAL;
use crate::matching::Match;
use crate::two_view::{self, Rays};
use weaver_geometry::glam::DVec2;
use weaver_geometry::{Camera, Pose};
use weaver_kernels::parallel;

/// Focal lengths that pairs vote for, over the usual one: the shortest, the ratio of neighbors, and their number.
const SHORTEST: f64 = 0.45;
const RATIO: f64 = 1.09;
const COUNT: usize = 24;
/// Numbers of the focal lengths at which a pose is searched; it is followed from there to the others.
const STARTS: [usize; 3] = [3, 9, 15];
/// Pairs that vote, at most, and most of one photo.
const VOTERS: usize = 18;
const OF_ONE: usize = 4;
/// Fewest matches of a voter, and the clearest ones that count.
const FEWEST: usize = 30;
const CLEAREST: usize = 200;
/// A spread of displacements, over the longer side, that shows that photos are well apart.
const WIDE: f64 = 0.04;
/// Another peak is tried if it has at least this part of the best support.
const RIVAL: f64 = 0.985;
/// Cost of an unusual focal length: matches for the square of its logarithm.
const UNUSUAL: f64 = 2.0;

/// Focal lengths over the usual one at which pairs of photos have their greatest support, the best first; `cameras`
/// have the usual one, and only their intrinsics count. Empty if no pair decides.
///
/// For each pair and focal length, the pose with the most agreeing matches is found; the sums over pairs are compared.
/// Pairs that stand nearly still agree with any focal length, so the pairs with the largest spread of displacements
/// vote.
pub(crate) fn voted(
    features: &[Features],
    cameras: &[Camera],
    matched: &[([usize; 2], Vec<Match>)],
    tau: f64,
) -> Vec<f64> {
    let pixels: Vec<Pixels> = matched.iter().map(|pair| Pixels::new(features, cameras, pair)).collect();
    let voters = voters(&pixels, matched);
    let mut profiles = vec![[0.0; COUNT]; voters.len()];
    parallel::for_chunks(&mut profiles, 1, |i, profile| profile[0] = pixels[voters[i]].profile(tau));
    let usual = |number: usize| UNUSUAL * factor(number).ln().powi(2);
    let total: [f64; COUNT] =
        std::array::from_fn(|number| profiles.iter().map(|p| p[number]).sum::<f64>() - usual(number));
    let at = |i: isize| usize::try_from(i).ok().and_then(|i| total.get(i)).copied().unwrap_or(f64::NEG_INFINITY);
    let peak = |i: &usize| at(*i as isize) >= at(*i as isize - 1) && at(*i as isize) > at(*i as isize + 1);
    let mut peaks: Vec<usize> = (0..COUNT).filter(peak).collect();
    peaks.sort_by(|a, b| total[*b].total_cmp(&total[*a]));
    peaks.retain(|p| !voters.is_empty() && total[*p] >= RIVAL * total.iter().copied().fold(0.0, f64::max));
    peaks
        .into_iter()
        .map(|i| factor(i) * RATIO.powf(between([at(i as isize - 1), total[i], at(i as isize + 1)])))
        .collect()
}

fn factor(number: usize) -> f64 {
    SHORTEST * RATIO.powi(number as i32) / USUAL
}

/// Position of a peak between its neighbors.
fn between([before, here, after]: [f64; 3]) -> f64 {
    let by = 0.5 * (after - before) / (2.0 * here - before - after);
    if by.is_finite() { by.clamp(-0.5, 0.5) } else { 0.0 }
}

/// The matches of a pair, from the middle of the photos, in usual focal lengths.
struct Pixels {
    matches: Vec<[DVec2; 2]>,
    /// Pixels of a usual focal length.
    focal: f64,
    /// Spread of displacements, over the longer side.
    spread: f64,
}

impl Pixels {
    fn new(features: &[Features], cameras: &[Camera], ([a, b], found): &([usize; 2], Vec<Match>)) -> Self {
        let at = |photo: usize, keypoint: usize| {
            cameras[photo].intrinsics.unproject(features[photo].keypoints[keypoint].pixel, 1.0).truncate()
        };
        let matches: Vec<[DVec2; 2]> = found
            .iter()
            .take(CLEAREST)
            .map(Match::numbers)
            .map(|[first, second]| [at(*a, first), at(*b, second)])
            .collect();
        let middle = |mut of: Vec<f64>| {
            of.sort_by(f64::total_cmp);
            of.get(of.len() / 2).copied().unwrap_or(0.0)
        };
        let moved: Vec<DVec2> = matches.iter().map(|[x, y]| *y - *x).collect();
        let center =
            DVec2::new(middle(moved.iter().map(|d| d.x).collect()), middle(moved.iter().map(|d| d.y).collect()));
        let spread = middle(moved.iter().map(|d| d.distance(center)).collect()) * USUAL;
        let focal = 0.5 * (cameras[*a].intrinsics.fx + cameras[*b].intrinsics.fx);
        Self { matches, focal, spread }
    }

    /// The greatest support with each focal length.
    fn profile(&self, tau: f64) -> [f64; COUNT] {
        let mut profile = [0.0; COUNT];
        for start in STARTS {
            let Some(view) = two_view::two_view(&self.scaled(start), tau / (self.focal * factor(start))) else {
                continue;
            };
            for numbers in [(start..COUNT).collect::<Vec<_>>(), (0..start).rev().collect()] {
                let mut pose: Pose = view.pose;
                for number in numbers {
                    let rays: Vec<Rays> = self.scaled(number).iter().filter_map(two_view::homogeneous).collect();
                    let (next, score) = two_view::followed(&pose, &rays, tau / (self.focal * factor(number)));
                    pose = next;
                    profile[number] = score.max(profile[number]);
                }
            }
        }
        profile
    }

    fn scaled(&self, number: usize) -> Vec<[DVec2; 2]> {
        self.matches.iter().map(|m| m.map(|x| x / factor(number))).collect()
    }
}

/// The pairs that vote: well apart, with the most matches, and not all of the same photos.
fn voters(pixels: &[Pixels], matched: &[([usize; 2], Vec<Match>)]) -> Vec<usize> {
    let value = |i: usize| (pixels[i].matches.len() as f64).sqrt() * (pixels[i].spread / WIDE).min(1.0);
    let mut order: Vec<usize> = (0..matched.len()).filter(|i| matched[*i].1.len() >= FEWEST).collect();
    order.sort_by(|a, b| value(*b).total_cmp(&value(*a)));
    let photos = matched.iter().map(|(pair, _)| pair[1] + 1).max().unwrap_or(0);
    let mut taken = vec![0; photos];
    order.retain(|i| {
        let pair = matched[*i].0;
        let free = pair.iter().all(|p| taken[*p] < OF_ONE);
        pair.iter().for_each(|p| taken[*p] += usize::from(free));
        free
    });
    order.truncate(VOTERS);
    order
}
