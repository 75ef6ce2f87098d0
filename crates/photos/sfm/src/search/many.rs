//! Scenes of many photos: the right explanation is chosen while they are small.

#[cfg(test)]
mod tests;

use super::{BEGINNINGS, CERTAIN, GROWN_APART, Search};
use crate::bundle::{Bundle, LARGE};
use crate::evidence::{Evidence, Trust};
use crate::features::Features;
use crate::grow::{Grown, beginnings};
use crate::lenses::{is_one_rig, tau};
use crate::pairs::{self, Pair, linked};
use crate::place::agreeing;
use crate::retrieval::expansion;
use crate::tracks::Track;

/// Photos of the small scenes by which explanations are compared.
const TRIAL: usize = 32;
/// Factor on the support of a rival that stayed small, relative to the kept scene's: settled, a wrong scene falls
/// further behind.
const UNSETTLED: f64 = 0.85;
/// Further photos that each is compared with because both share content with a third one.
const MORE: usize = 4;
/// No further scene is grown once one has a place for this part of the photos, and this part of the matches agrees with
/// it.
const NEARLY_ALL: f64 = 0.9;
/// A pair is strong if it has at least this part of the matches of the best pair of either photo: where things repeat,
/// photos of different ones have fewer matches than neighbors.
const STRONG: f64 = 0.5;
/// The share of its matches that must agree with the placed cameras, so that points are found from a pair.
const FITTING: f64 = 0.5;

impl Search<'_> {
    /// Grows scenes from the best small scene.
    pub(super) fn run_many(&mut self) {
        let tau = tau(self.taken);
        let mut best: Option<(Grown, Bundle, Ranked)> = None;
        let mut others: Vec<Grown> = Vec::new();
        let mut expanded = false;
        // Of many photos, the ones by which further focal lengths are compared with the first.
        let mut compared: Option<Vec<bool>> = None;
        for factor in self.focal_lengths(tau) {
            let bundle = self.settings.bundle(self.taken, factor);
            let within = |photos: &[usize; 2]| {
                compared.as_ref().is_none_or(|compared| photos.iter().all(|photo| compared[*photo]))
            };
            let matched = self.pairs.matched.iter().filter(|(photos, _)| within(photos));
            let mut posed = pairs::posed(self.features, &bundle.cameras, matched, tau);
            // Matching does not depend on the focal length, so that further pairs are matched once.
            if !expanded {
                expanded = true;
                posed.extend(self.expanded(&posed, &bundle, tau));
            }
            let part = compared.is_some();
            let posed = Ranked { part, ..Ranked::new(posed, self.taken.len()) };
            let mut trials = self.trials(&bundle, &posed.pairs[..posed.ends[0]]);
            if self.taken.len() > LARGE && compared.is_none() && !trials.is_empty() {
                compared = Some(around(&trials, &posed.pairs[..posed.ends[2]], self.taken.len()));
            }
            trials.sort_by(|a, b| b.each().total_cmp(&a.each()));
            let mut trials = trials.into_iter();
            if let Some(first) = trials.next() {
                others.extend(trials);
                if best.as_ref().is_none_or(|(best, ..)| first.each() > best.each()) {
                    others.extend(best.replace((first, bundle, posed)).map(|(before, ..)| before));
                } else {
                    others.push(first);
                }
            }
        }
        let Some((trial, bundle, mut posed)) = best else { return };
        let rivals = others.iter().filter(|other| trial.differs(other, GROWN_APART));
        self.given_up = UNSETTLED * rivals.map(|other| other.each() / trial.each()).fold(0.0, f64::max);
        // Scenes of many photos take much memory: only the kept one grows on.
        drop(others);
        if posed.part {
            let all = pairs::posed(self.features, &bundle.cameras, &self.pairs.matched, tau);
            posed = Ranked::new(all, self.taken.len());
        }
        // Matches that agree with no pose are not read any more.
        self.pairs.matched.iter_mut().for_each(|(_, matches)| *matches = Vec::new());
        let mut begun = Some(trial);
        // The strongest pairs first; the others only if these do not explain nearly all.
        for end in [0, 2, 1].map(|level| posed.ends[level]) {
            self.grow_many(&bundle, &posed.pairs, end, begun.take());
            if self.found.iter().any(|grown| self.explains(grown, &posed.pairs[..posed.ends[2]])) {
                break;
            }
        }
        self.pairs.posed = posed.pairs;
    }

    /// Matches pairs of photos whose overlap with a third photo is certain; returns the ones that have a pose.
    fn expanded(&mut self, posed: &[Pair], bundle: &Bundle, tau: f64) -> Vec<Pair> {
        let verified = posed.iter().filter(|pair| pair.certain(CERTAIN[0]));
        let verified: Vec<([usize; 2], usize)> = verified.map(|pair| (pair.photos, pair.matches.len())).collect();
        let tried: Vec<[usize; 2]> = self.pairs.matched.iter().map(|(photos, _)| *photos).collect();
        let mut more = expansion(&vec![true; self.taken.len()], &verified, &tried, MORE);
        more.retain(|pair| !is_one_rig(self.taken, pair));
        let matched = pairs::matched(self.features, &more);
        let posed = pairs::posed(self.features, &bundle.cameras, &matched, tau);
        self.pairs.matched.extend(matched);
        posed
    }

    /// Small scenes from the first initial pair that grows to a full trial, one for each of its poses.
    fn trials(&self, bundle: &Bundle, certain: &[Pair]) -> Vec<Grown> {
        let tracks = linked(self.features, certain);
        let absent = vec![false; self.taken.len()];
        let evidence = self.evidence(certain, &tracks, &absent);
        let mut trials: Vec<Grown> = Vec::new();
        for from in beginnings(&evidence).into_iter().take(BEGINNINGS).map(|i| &certain[i]) {
            for pose in std::iter::once(&from.pose).chain(&from.rival) {
                let mut grown = Grown::new(bundle.clone(), from.photos, pose);
                grown.grow_locally(&evidence, TRIAL);
                grown.settle(&evidence);
                trials.push(grown);
            }
            if trials.iter().any(|grown| grown.value().0 >= TRIAL) {
                break;
            }
        }
        trials
    }

    fn evidence<'b>(&'b self, pairs: &'b [Pair], tracks: &'b [Track], absent: &'b [bool]) -> Evidence<'b> {
        Evidence { features: self.features, pairs, tracks, absent, trust: Trust::PAIRS }
    }

    /// True if a scene has a place for nearly all photos, and nearly all matches of these pairs agree with it.
    fn explains(&self, grown: &Grown, certain: &[Pair]) -> bool {
        let [mut agree, mut all] = [0, 0];
        for pair in certain.iter().filter(|pair| pair.photos.iter().all(|photo| grown.placed[*photo])) {
            agree += grown.agreeing(self.features, pair);
            all += pair.matches.len();
        }
        let part = |of: usize, all: usize| of as f64 >= NEARLY_ALL * all as f64;
        part(grown.value().0, self.taken.len()) && part(agree, all)
    }

    /// Goes on with a scene by the first `end` pairs, and grows others from initial pairs that it does not reach.
    fn grow_many(&mut self, bundle: &Bundle, posed: &[Pair], end: usize, begun: Option<Grown>) {
        let certain = &posed[..end];
        let tracks = linked(self.features, certain);
        let absent = vec![false; self.taken.len()];
        let features = self.features;
        // Matches of certain pairs may place a photo alone; later, with the other fitting pairs, points must.
        let evidence = Evidence { features, pairs: certain, tracks: &tracks, absent: &absent, trust: Trust::PAIRS };
        let first = self.found.len();
        let finish = |mut grown: Grown| {
            grown.grow_locally(&evidence, usize::MAX);
            // A pair that contradicts the scene is chance, and no evidence about the rest.
            let fits = |pair: &&Pair| {
                pair.photos.iter().any(|photo| !grown.placed[*photo])
                    || grown.agreeing(features, pair) as f64 >= FITTING * pair.matches.len() as f64
            };
            let fitting: Vec<Pair> = posed.iter().filter(fits).cloned().collect();
            let tracks = linked(features, &fitting);
            let all = Evidence { pairs: &fitting, tracks: &tracks, trust: Trust::POINTS, ..evidence };
            grown.grow_locally(&all, usize::MAX);
            grown.settle(&all);
            grown
        };
        self.found.extend(begun.map(finish));
        for from in beginnings(&evidence).into_iter().map(|i| &certain[i]) {
            let grown = &self.found[first..];
            let reached = |photo: usize| grown.iter().any(|grown| grown.placed[photo]);
            let most = grown.iter().map(|grown| grown.value().0).max().unwrap_or(0);
            // A scene of the remaining photos must be able to become the largest.
            let left = (0..self.taken.len()).filter(|photo| !reached(*photo)).count();
            if grown.len() == BEGINNINGS || left <= most {
                break;
            }
            if from.photos.iter().all(|photo| reached(*photo)) {
                continue;
            }
            let found = finish(Grown::new(bundle.clone(), from.photos, &from.pose));
            self.found.push(found);
        }
    }
}

/// The photos of trials, and the ones that have a certain pair with one of these.
fn around(trials: &[Grown], certain: &[Pair], photos: usize) -> Vec<bool> {
    let of_trials: Vec<bool> = (0..photos).map(|photo| trials.iter().any(|grown| grown.placed[photo])).collect();
    let mut around = of_trials.clone();
    for pair in certain.iter().filter(|pair| pair.photos.iter().any(|photo| of_trials[*photo])) {
        pair.photos.iter().for_each(|photo| around[*photo] = true);
    }
    around
}

/// Pairs with a pose, the least likely to be chance first.
struct Ranked {
    pairs: Vec<Pair>,
    /// Ends of the ranks in `pairs`: strong pairs with the larger share of [`CERTAIN`], all pairs with the larger
    /// share, and all pairs with the smaller share.
    ends: [usize; 3],
    /// True if they are only the pairs by which focal lengths are compared.
    part: bool,
}

impl Ranked {
    fn new(mut pairs: Vec<Pair>, photos: usize) -> Self {
        let mut most = vec![0; photos];
        for pair in pairs.iter().filter(|pair| pair.certain(CERTAIN[0])) {
            pair.photos.iter().for_each(|photo| most[*photo] = pair.matches.len().max(most[*photo]));
        }
        let strong = |pair: &Pair| {
            let most = pair.photos.iter().map(|photo| most[*photo]).min().unwrap_or(0);
            pair.matches.len() as f64 >= STRONG * most as f64
        };
        let rank = |pair: &Pair| match [pair.certain(CERTAIN[1]), pair.certain(CERTAIN[0])] {
            [true, _] => usize::from(!strong(pair)),
            [false, true] => 2,
            [false, false] => 3,
        };
        let ranks: Vec<usize> = pairs.iter().map(rank).collect();
        let ends = [1, 2, 3].map(|end| ranks.iter().filter(|rank| **rank < end).count());
        pairs.sort_by_key(rank);
        Self { pairs, ends, part: false }
    }
}

impl Grown {
    /// Number of matches of a pair that agree with its cameras.
    fn agreeing(&self, features: &[Features], pair: &Pair) -> usize {
        agreeing(features, pair, &pair.photos.map(|photo| self.bundle.camera(photo)))
    }

    /// Mean support of a photo; missing photos of a full trial count as 0.
    fn each(&self) -> f64 {
        self.support / self.value().0.max(TRIAL) as f64
    }
}
