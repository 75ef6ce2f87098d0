//! Scenes of many photos: which explanation is right is told while they are small.

#[cfg(test)]
mod tests;

use super::{BEGINNINGS, CERTAIN, Search};
use crate::bundle::Bundle;
use crate::evidence::{Evidence, Trust};
use crate::grow::{Grown, beginnings};
use crate::lenses::tau;
use crate::pairs::{self, Pair, linked};
use crate::retrieval::expansion;

/// Photos by which explanations are told apart.
const TRIAL: usize = 32;
/// Photos that each is compared with for what both have in common with a third one.
const MORE: usize = 4;
/// The part of the photos that a scene must reach for no stricter one to be tried.
const NEARLY_ALL: f64 = 0.9;

impl Search<'_> {
    /// Grows scenes from what explains most of some photos.
    pub(super) fn run_many(&mut self) {
        let tau = tau(self.taken);
        let mut best: Option<(Grown, Bundle, Vec<Pair>)> = None;
        let mut others: Vec<Grown> = Vec::new();
        let mut expanded = false;
        for factor in self.focal_lengths(tau) {
            let bundle = self.settings.bundle(self.taken, factor);
            let mut posed = pairs::posed(self.features, &bundle.cameras, &self.pairs.matched, tau);
            if !expanded {
                expanded = true;
                posed.extend(self.expanded(&posed, &bundle, tau));
            }
            // The most certain ones first.
            posed.sort_by_key(|pair| CERTAIN.iter().filter(|share| !pair.certain(**share)).count());
            let mut trials = self.trials(&bundle, &posed);
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
        let Some((trial, bundle, posed)) = best else { return };
        let rivals = others.iter().filter(|other| trial.differs(other));
        self.given_up = rivals.map(|other| other.each() / trial.each()).fold(0.0, f64::max);
        drop(others);
        // Nothing looks at what agrees with no pose any more.
        self.pairs.matched.iter_mut().for_each(|(_, matches)| *matches = Vec::new());
        for (strict, share) in CERTAIN.into_iter().enumerate() {
            let begun = (strict == 0).then(|| trial.clone());
            self.grow_many(&bundle, &posed, share, begun);
            let most = self.found.iter().map(|grown| grown.value().0).max().unwrap_or(0);
            if most as f64 >= NEARLY_ALL * self.taken.len() as f64 {
                break;
            }
        }
        self.pairs.posed = posed;
    }

    /// Matches pairs of photos that are certain to show what a third one does; returns those that have a pose.
    fn expanded(&mut self, posed: &[Pair], bundle: &Bundle, tau: f64) -> Vec<Pair> {
        let verified = posed.iter().filter(|pair| pair.certain(CERTAIN[0]));
        let verified: Vec<([usize; 2], usize)> = verified.map(|pair| (pair.photos, pair.matches.len())).collect();
        let tried: Vec<[usize; 2]> = self.pairs.matched.iter().map(|(photos, _)| *photos).collect();
        let more = expansion(&vec![true; self.taken.len()], &verified, &tried, MORE);
        let matched = pairs::matched(self.features, &more);
        let posed = pairs::posed(self.features, &bundle.cameras, &matched, tau);
        self.pairs.matched.extend(matched);
        posed
    }

    /// Small scenes from the first beginning that leads somewhere, one for each of its poses.
    fn trials(&self, bundle: &Bundle, posed: &[Pair]) -> Vec<Grown> {
        let certain = certain(posed, CERTAIN[0]);
        let tracks = linked(self.features, certain);
        let absent = vec![false; self.taken.len()];
        let evidence =
            Evidence { features: self.features, pairs: certain, tracks: &tracks, absent: &absent, trust: Trust::PAIRS };
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

    /// Grows a scene that has begun by pairs of which at least this share of the matches agrees, and others where it does not
    /// reach.
    fn grow_many(&mut self, bundle: &Bundle, posed: &[Pair], share: f64, begun: Option<Grown>) {
        let absent = vec![false; self.taken.len()];
        let certain = certain(posed, share);
        let (all_tracks, tracks) = (linked(self.features, posed), linked(self.features, certain));
        let evidence =
            Evidence { features: self.features, pairs: certain, tracks: &tracks, absent: &absent, trust: Trust::PAIRS };
        let all = Evidence { pairs: posed, tracks: &all_tracks, trust: Trust::POINTS, ..evidence };
        let first = self.found.len();
        let finish = |mut grown: Grown| {
            grown.grow_locally(&evidence, usize::MAX);
            grown.grow_locally(&all, usize::MAX);
            grown.settle(&all);
            grown
        };
        self.found.extend(begun.map(finish));
        for from in beginnings(&evidence).into_iter().map(|i| &certain[i]) {
            let grown = &self.found[first..];
            let reached = |photo: usize| grown.iter().any(|grown| grown.placed[photo]);
            let most = grown.iter().map(|grown| grown.value().0).max().unwrap_or(0);
            // What is left must be able to become the largest.
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

/// Those that are certain, of pairs that begin with the most certain ones.
fn certain(posed: &[Pair], share: f64) -> &[Pair] {
    &posed[..posed.partition_point(|pair| pair.certain(share))]
}

impl Grown {
    /// What is explained of each photo, of as many as there should be.
    fn each(&self) -> f64 {
        self.support / self.value().0.max(TRIAL) as f64
    }
}
