//! A scene that grows photo by photo, from two.

mod local;

use crate::bundle::{Bundle, Observation};
use crate::evidence::{EXACT, Evidence, FITS, STEPS};
use crate::pairs::Pair;
use crate::place::{Place, by_pixel, place, tally};
pub(crate) use local::MANY;
use weaver_geometry::Pose;
use weaver_kernels::parallel;

/// Scales of an adjustment while the scene grows and in the end, in deviations of keypoints, and its steps.
const GROWING: [(f64, usize); 1] = [(4.0, 8)];
const GROWN: [(f64, usize); 2] = [(4.0, STEPS), (2.0, STEPS)];
/// Cameras join together if their inlier count is at least this part of the best one's.
const TOGETHER: f64 = 0.4;
/// If some photos' matches agree with their places by this share, other photos wait.
const CLEAR: f64 = 0.8;
/// A camera that sees fewer points loses its place again.
const LOST: usize = 6;
/// Number of times that photos are taken out again because most of their matches contradict their place.
const RETRACTIONS: usize = 5;
/// The share of its matches that must agree with a photo's pose in the end.
const MOST: f64 = 0.5;
/// Angle between rays that is wide enough for an initial pair, radians.
const WIDE: f64 = 0.1;

/// A scene with the cameras that have a place in it.
#[derive(Clone, Debug)]
pub(crate) struct Grown {
    pub bundle: Bundle,
    pub placed: Vec<bool>,
    /// Support: the sum of the observations' weights by their residuals.
    pub support: f64,
}

/// Initial pairs, the best first: many matches, seen from different places.
pub(crate) fn beginnings(evidence: &Evidence<'_>) -> Vec<usize> {
    let value = |pair: &Pair| pair.score * (pair.parallax / WIDE).min(1.0) * (1.0 - pair.turned);
    let present = |i: &usize| evidence.pairs[*i].photos.iter().all(|p| !evidence.absent[*p]);
    let mut order: Vec<usize> = (0..evidence.pairs.len()).filter(present).collect();
    order.retain(|i| !evidence.pairs[*i].turned());
    order.sort_by(|a, b| value(&evidence.pairs[*b]).total_cmp(&value(&evidence.pairs[*a])));
    order
}

impl Grown {
    /// Two photos with their relative pose. `bundle` has a camera for each photo; their poses are ignored.
    pub fn new(mut bundle: Bundle, [a, b]: [usize; 2], pose: &Pose) -> Self {
        let mut placed = vec![false; bundle.cameras.len()];
        bundle.together(a).chain(bundle.together(b)).for_each(|photo| placed[photo] = true);
        bundle.put(a, Pose::IDENTITY);
        bundle.put(b, *pose);
        bundle.together(a).for_each(|photo| bundle.fixed[photo] = true);
        Self { bundle, placed, support: 0.0 }
    }

    /// Places photo after photo, as long as one sees enough points of the scene.
    pub fn grow(&mut self, evidence: &Evidence<'_>) {
        let Self { bundle, placed, support } = self;
        let mut refused = evidence.absent.to_vec();
        let mut retractions = RETRACTIONS;
        let free: Vec<bool> = bundle.lenses.iter().map(|lens| lens.free_focal).collect();
        loop {
            // Two cameras hardly determine their focal length.
            let several = placed.iter().filter(|p| **p).count() > 2;
            let freed: Vec<bool> = free.iter().map(|free| *free && several).collect();
            bundle.free_focal(&freed, placed);
            let all = adjusted(evidence, bundle, placed, &GROWING);
            for photo in lost(bundle, placed) {
                (placed[photo], refused[photo]) = (false, true);
            }
            let joined = join(evidence, bundle, placed, &refused, &all, TOGETHER);
            let wrong =
                if joined.is_empty() && retractions > 0 { contradicted(evidence, bundle, placed) } else { vec![] };
            if joined.is_empty() && wrong.is_empty() {
                break;
            }
            retractions -= usize::from(!wrong.is_empty());
            joined.into_iter().for_each(|photo| placed[photo] = true);
            wrong.into_iter().for_each(|photo| placed[photo] = false);
        }
        bundle.free_focal(&free, placed);
        adjusted(evidence, bundle, placed, &GROWN);
        *support = explained(bundle);
        bundle.lenses.iter_mut().zip(free).for_each(|(lens, free)| lens.free_focal = free);
    }

    /// Finds points for the cameras as they are, and adjusts both.
    pub fn adjust(&mut self, evidence: &Evidence<'_>) {
        adjusted(evidence, &mut self.bundle, &self.placed, &GROWN);
        self.support = explained(&self.bundle);
    }

    /// The same without a photo that has a place, and without the others of its rig; `None` where it has none, or too
    /// few are left.
    pub fn without(&self, photo: usize) -> Option<Self> {
        let mut rest = self.clone();
        self.bundle.together(photo).for_each(|photo| rest.placed[photo] = false);
        let first = rest.placed.iter().position(|placed| *placed)?;
        if self.bundle.fixed[photo] {
            self.bundle.together(photo).for_each(|photo| rest.bundle.fixed[photo] = false);
            self.bundle.together(first).for_each(|first| rest.bundle.fixed[first] = true);
        }
        let left = (0..rest.placed.len()).filter(|i| rest.placed[*i] && self.bundle.leads(*i)).count();
        (self.placed[photo] && left > 1).then_some(rest)
    }

    /// Places a photo anew, with its rig.
    pub fn rejoin(&mut self, evidence: &Evidence<'_>, photo: usize) {
        let absent: Vec<bool> = (0..self.placed.len()).map(|i| !self.bundle.together(photo).contains(&i)).collect();
        self.join(&Evidence { absent: &absent, ..*evidence });
    }

    /// Places, once, every photo that sees enough points of the scene; nothing else moves.
    pub fn join(&mut self, evidence: &Evidence<'_>) {
        let missing: Vec<bool> = self.placed.iter().map(|placed| !placed).collect();
        let all = self.bundle.observe(evidence.features, evidence.tracks, &missing, 2.0 * FITS);
        self.bundle.observations = all.iter().filter(|o| self.placed[o.camera]).copied().collect();
        let joined = join(evidence, &mut self.bundle, &self.placed, evidence.absent, &all, 0.0);
        joined.into_iter().for_each(|photo| self.placed[photo] = true);
    }
}

/// Finds points and adjusts them with the cameras; returns the observations of the points in all photos.
fn adjusted(
    evidence: &Evidence<'_>,
    bundle: &mut Bundle,
    placed: &[bool],
    scales: &[(f64, usize)],
) -> Vec<Observation> {
    let missing: Vec<bool> = placed.iter().map(|placed| !placed).collect();
    let all = bundle.observe(evidence.features, evidence.tracks, &missing, 2.0 * FITS);
    bundle.observations = all.iter().filter(|o| placed[o.camera]).copied().collect();
    for (scale, steps) in scales {
        bundle.adjust_roughly(*scale, *steps);
    }
    bundle.leave_out(FITS);
    all
}

/// Cameras that see too few points after all.
fn lost(bundle: &Bundle, placed: &[bool]) -> Vec<usize> {
    let agreed = bundle.agreed();
    let mut seen = vec![0; placed.len()];
    bundle.observations.iter().filter(|o| agreed[o.point]).for_each(|o| seen[o.camera] += 1);
    let seen = bundle.summed(seen);
    (0..placed.len()).filter(|i| placed[*i] && seen[*i] < LOST).collect()
}

/// Photos whose matches with other placed ones mostly contradict their place.
fn contradicted(evidence: &Evidence<'_>, bundle: &Bundle, placed: &[bool]) -> Vec<usize> {
    let wrong = |photo: &usize| {
        let [agree, all] = tally(evidence, bundle, placed, &bundle.cameras[*photo].pose, *photo);
        placed[*photo] && (agree as f64) < MOST * all as f64
    };
    let first = (0..placed.len()).filter(|photo| bundle.leads(*photo));
    first.filter(wrong).flat_map(|photo| bundle.together(photo)).collect()
}

/// Support: the exactly fitting part of the observations, less the cost of an unexpected focal length.
pub(crate) fn explained(bundle: &Bundle) -> f64 {
    let agreed = bundle.agreed();
    let value = |(o, fit): (&Observation, f64)| if agreed[o.point] { fit } else { 0.0 };
    let prior: f64 =
        bundle.lenses.iter().filter(|l| l.free_focal).map(|l| l.weight * (l.log_focal - l.expected).powi(2)).sum();
    bundle.observations.iter().zip(bundle.fits(EXACT)).map(value).sum::<f64>() - prior
}

/// Places cameras that see enough points, a rig as one; returns which.
fn join(
    evidence: &Evidence<'_>,
    bundle: &mut Bundle,
    placed: &[bool],
    refused: &[bool],
    all: &[Observation],
    together: f64,
) -> Vec<usize> {
    let agreed = bundle.agreed();
    let mut seen: Vec<Vec<Observation>> = vec![Vec::new(); placed.len()];
    all.iter().filter(|o| agreed[o.point]).for_each(|o| seen[o.camera].push(*o));
    // By pixel, so that the points of a keypoint are found fast.
    seen.iter_mut().for_each(|seen| seen.sort_by(|a, b| by_pixel(a.pixel, b.pixel)));
    let mut found: Vec<Option<Place>> = vec![None; placed.len()];
    parallel::for_chunks(&mut found, 1, |photo, found| {
        if bundle.leads(photo) && !placed[photo] && !refused[photo] {
            found[0] = place(evidence, bundle, placed, &seen, photo);
        }
    });
    // Photos without contradicting matches come first: the points that they add decide the places of the others.
    let clear = found.iter().flatten().any(|f| f.share >= CLEAR);
    found.iter_mut().for_each(|found| *found = found.filter(|f| !clear || f.share >= CLEAR));
    let most = found.iter().flatten().map(|f| f.count).max().unwrap_or(0);
    let mut joined = Vec::new();
    for (photo, found) in found.into_iter().enumerate() {
        if let Some(Place { pose, .. }) = found.filter(|f| f.count as f64 >= together * most as f64) {
            bundle.put(photo, pose);
            joined.extend(bundle.together(photo));
        }
    }
    joined
}
