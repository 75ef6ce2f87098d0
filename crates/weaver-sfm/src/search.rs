//! Scenes that explain photos, of which the best is taken.

use crate::bundle::Bundle;
use crate::evidence::{Evidence, Trust};
use crate::features::Features;
use crate::focal;
use crate::grow::{Grown, beginnings};
use crate::lenses::{PIXEL, USUAL};
use crate::matching::Match;
use crate::pairs::{self, Pair};
use crate::passes::{Pass, neighbors};
use crate::photo::{EstimateSettings, Photo};
use crate::tracks::{Track, tracks};

/// Focal lengths that are tried where nothing is known.
const FOCAL_LENGTHS: usize = 2;
/// Standard deviation of the principal point from the middle of a photo, over the longer side.
const OFF_CENTER: f64 = 0.005;
/// Photos of which many beginnings and every focal length can be tried.
const FEW: usize = 8;
/// Beginnings that are tried, and the most photos of which more than one is where the first reaches all.
const BEGINNINGS: usize = 6;
const SEVERAL: usize = 12;
/// The part of what another scene explains that one explains from which on they confirm each other.
const ALIKE: f64 = 0.9;
/// The share of the matches of a pair that must agree where there are many photos. What leads one scene astray need not lead the
/// other.
const CERTAIN: [f64; 2] = [0.5, 0.65];
/// How far off a photo may be that pairs put in its place, in deviations of keypoints.
const ASTRAY: f64 = 32.0;
/// Rotations farther apart than this are different, radians; explanations are in which one of so many photos differs.
const DIFFERENT: f64 = 0.1;
const ONE_IN: usize = 8;

/// What was tried.
pub(crate) struct Search<'a> {
    photos: &'a [Photo<'a>],
    settings: &'a EstimateSettings,
    features: &'a [Features],
    matched: &'a [([usize; 2], Vec<Match>)],
    /// The scenes that were grown.
    pub found: Vec<Grown>,
}

impl<'a> Search<'a> {
    pub fn new(
        photos: &'a [Photo<'a>],
        settings: &'a EstimateSettings,
        features: &'a [Features],
        matched: &'a [([usize; 2], Vec<Match>)],
    ) -> Self {
        Self { photos, settings, features, matched, found: Vec::new() }
    }

    /// Grows scenes; returns the pairs' poses with the last focal length.
    pub fn run(&mut self) -> Vec<Pair> {
        let tau = self.photos.iter().map(|p| p.size[1] as f64 / 384.0).fold(0.5, f64::max);
        let few = self.photos.len() <= FEW;
        let mut posed = Vec::new();
        for factor in self.focal_lengths(tau) {
            let bundle = self.settings.bundle(self.photos, factor);
            posed = pairs::posed(self.features, &bundle.cameras, self.matched, tau);
            // Among many photos, pairs that are chance do more harm than those that are doubtful do good.
            let certain: &[f64] = if few { &[0.0] } else { &CERTAIN };
            // A photo that is only located links nothing: what it shows would otherwise join points of the others.
            let between: Vec<Pair> = posed.iter().filter(|pair| !self.locates(&pair.photos)).cloned().collect();
            certain.iter().for_each(|share| self.grow(&bundle, &between, *share));
        }
        posed
    }

    /// Whether one of two photos is only located.
    fn locates(&self, pair: &[usize; 2]) -> bool {
        pair.iter().any(|p| self.photos[*p].located)
    }

    /// Grows scenes by pairs of which at least this share of the matches agrees.
    fn grow(&mut self, bundle: &Bundle, posed: &[Pair], share: f64) {
        let few = self.photos.len() <= FEW;
        let absent: Vec<bool> = self.photos.iter().map(|p| p.located).collect();
        let certain: Vec<Pair> = posed.iter().filter(|pair| few || pair.certain(share)).cloned().collect();
        let (all_tracks, tracks) = (self.linked(posed), self.linked(&certain));
        let evidence = Evidence {
            features: self.features,
            pairs: &certain,
            tracks: &tracks,
            absent: &absent,
            trust: Trust::PAIRS,
        };
        let all = Evidence { pairs: posed, tracks: &all_tracks, trust: Trust::POINTS, ..evidence };
        let first = self.found.len();
        let mut tried = 0;
        for from in beginnings(&evidence).into_iter().map(|i| &certain[i]) {
            // Of many photos, the next beginning is in what the others did not reach.
            let reached = |grown: &Grown| from.photos.iter().all(|p| grown.placed[*p]);
            let grown = &self.found[first..];
            if tried == BEGINNINGS || confirmed(grown) || self.photos.len() > SEVERAL && grown.iter().any(reached) {
                continue;
            }
            tried += 1;
            for pose in std::iter::once(&from.pose).chain(&from.rival) {
                let mut grown = Grown::new(bundle.clone(), from.photos, pose);
                grown.grow(&evidence);
                if !few {
                    grown.grow(&all);
                }
                self.found.push(grown);
            }
        }
    }

    /// Matches and adjusts by turns, until all that photos share is found.
    pub fn refine(&self, bundle: &mut Bundle, placed: &[bool]) {
        let several = placed.iter().filter(|placed| **placed).count() >= SEVERAL;
        let free: Vec<bool> = bundle.lenses.iter().map(|lens| lens.free_focal).collect();
        bundle.free_focal(&free, placed);
        for lens in &mut bundle.lenses {
            (lens.free_k1, lens.free_shift) = (self.settings.distortion, several);
            lens.shift_weight = (PIXEL / OFF_CENTER).powi(2);
        }
        let missing: Vec<bool> = placed.iter().map(|placed| !placed).collect();
        let near = self.near(bundle, placed);
        for pass in Pass::FINE {
            bundle.pass(self.features, &near, &missing, &pass);
        }
        bundle.finish();
    }

    /// Places the photos that are only located, by the points that the others found; these stay as they are.
    pub fn locate(&self, posed: &[Pair], bundle: &mut Bundle, placed: &mut [bool]) {
        let absent: Vec<bool> = self.photos.iter().map(|p| !p.located).collect();
        if absent.iter().all(|absent| *absent) {
            return;
        }
        let tracks = self.linked(posed);
        let evidence =
            Evidence { features: self.features, pairs: posed, tracks: &tracks, absent: &absent, trust: Trust::PAIRS };
        let before = placed.to_vec();
        let mut found = Grown { bundle: bundle.clone(), placed: before.clone(), support: 0.0 };
        found.bundle.lenses.iter_mut().for_each(|lens| *lens = lens.held());
        found.join(&evidence);
        placed.copy_from_slice(&found.placed);
        let near = self.near(&found.bundle, placed);
        let located: Vec<bool> = before.iter().map(|placed| !placed).collect();
        found.bundle.fixed = before;
        // Pairs alone can put a photo a few degrees off: what is right is then far from epipolar lines.
        let passes = std::iter::once(Pass::wide(ASTRAY)).chain(Pass::FINE);
        passes.for_each(|pass| found.bundle.pass(self.features, &near, &located, &pass));
        bundle.cameras = found.bundle.cameras;
    }

    /// Pairs of placed photos from nearby.
    fn near(&self, bundle: &Bundle, placed: &[bool]) -> Vec<[usize; 2]> {
        let mut near = neighbors(&bundle.cameras, self.settings.candidates);
        near.retain(|pair| pair.iter().all(|p| placed[*p]));
        near
    }

    /// What pairs say to be the same.
    fn linked(&self, pairs: &[Pair]) -> Vec<Track> {
        let links: Vec<([usize; 2], Vec<Match>)> = pairs.iter().map(|p| (p.photos, p.matches.clone())).collect();
        let counts: Vec<usize> = self.features.iter().map(|f| f.keypoints.len()).collect();
        tracks(&counts, &links)
    }

    /// The scene that explains most.
    pub fn best(&self) -> Option<usize> {
        let value = |i: usize| self.found[i].value();
        (0..self.found.len()).reduce(|a, b| if value(b) > value(a) { b } else { a })
    }

    /// How much is explained by the best explanation that is different, over that by the best.
    pub fn rival(&self, best: usize) -> f64 {
        let best = &self.found[best];
        let others = self.found.iter().filter(|other| best.differs(other));
        others.map(|other| other.support / best.support).fold(0.0, f64::max)
    }

    /// Focal lengths to begin with, over the longer side: what is known, or those that pairs vote for.
    fn focal_lengths(&self, tau: f64) -> Vec<f64> {
        if self.photos.iter().any(|p| p.focal.is_some()) {
            return vec![USUAL];
        }
        let mut between = self.matched.to_vec();
        between.retain(|(pair, _)| !self.locates(pair));
        let usual = self.settings.bundle(self.photos, USUAL).cameras;
        let mut voted: Vec<f64> = focal::voted(self.features, &usual, &between, tau).into_iter().map(|f| f * USUAL).collect();
        voted.truncate(FOCAL_LENGTHS);
        if voted.is_empty() { vec![USUAL] } else { voted }
    }
}

/// Whether two scenes from different beginnings, and no better one, say the same.
fn confirmed(found: &[Grown]) -> bool {
    let Some(best) = (0..found.len()).reduce(|a, b| if found[b].value() > found[a].value() { b } else { a }) else {
        return false;
    };
    let alike = |other: &Grown| {
        other.value().0 == found[best].value().0
            && other.support > ALIKE * found[best].support
            && !found[best].differs(other)
    };
    (0..found.len()).any(|i| i != best && alike(&found[i]))
}

impl Grown {
    /// Photos with a place, then how well they explain each other.
    fn value(&self) -> (usize, f64) {
        (self.placed.iter().filter(|placed| **placed).count(), self.support)
    }

    /// Whether enough photos are turned another way relative to the rest.
    fn differs(&self, other: &Self) -> bool {
        let both: Vec<usize> = (0..self.placed.len()).filter(|i| self.placed[*i] && other.placed[*i]).collect();
        let turn =
            |bundle: &Bundle, i: usize, from: usize| bundle.cameras[i].pose.relative_to(&bundle.cameras[from].pose);
        let turned =
            |i: usize, from: usize| turn(&self.bundle, i, from).angle_to(&turn(&other.bundle, i, from)) > DIFFERENT;
        // Seen from the photo that agrees with most.
        let fewest = both.iter().map(|from| both.iter().filter(|i| turned(**i, *from)).count()).min();
        fewest.is_some_and(|fewest| fewest > 0 && fewest * ONE_IN >= both.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::glam::{DMat3, DVec3};
    use weaver_geometry::{Camera, Intrinsics, Pose};

    /// Sixteen photos, of which these are turned, in a world that is turned.
    fn grown(turned: &[usize], world: f64) -> Grown {
        let camera = |i: usize| {
            let own = if turned.contains(&i) { 2.0 * DIFFERENT } else { 0.0 };
            let rotation = DMat3::from_rotation_y(own + 0.05 * i as f64) * DMat3::from_rotation_x(world);
            let intrinsics = Intrinsics { fx: 1.0, fy: 1.0, cx: 0.5, cy: 0.5 };
            Camera { pose: Pose::new(rotation, DVec3::ZERO), intrinsics, width: 1, height: 1 }
        };
        let bundle = Bundle { cameras: (0..16).map(camera).collect(), ..Bundle::default() };
        Grown { bundle, placed: vec![true; 16], support: 1.0 }
    }

    #[test]
    fn explanations_differ_by_photos_and_not_by_their_world() {
        let first = grown(&[], 0.0);
        assert!(!first.differs(&grown(&[], 0.7)));
        assert!(!first.differs(&grown(&[0], 0.7)), "one of many");
        assert!(first.differs(&grown(&[0, 9], 0.7)) && grown(&[0, 9], 0.7).differs(&first));
    }
}
