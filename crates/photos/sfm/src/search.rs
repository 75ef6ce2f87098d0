//! Search for the scene that explains the photos best.

mod many;
mod settle;

use crate::bundle::Bundle;
use crate::evidence::{Evidence, Trust};
use crate::features::Features;
use crate::focal;
use crate::grow::{Grown, MANY, beginnings};
use crate::lenses::{Taken, USUAL, tau};
use crate::pairs::{self, Pair, Pairs, linked};
use crate::passes::Compared;
use crate::photo::{EstimateOptions, Photo};
use crate::place::agreeing;
use crate::ties::untied;
use crate::turning::turning;

/// Points that a photo with a camera must see at least, as many as [`Trust::POINTS`] takes to place it.
const LEAST_SEEN: usize = 25;
/// Focal lengths, the best by the votes of pairs, that are tried if none is given.
const FOCAL_LENGTHS: usize = 2;
/// Photos up to which pairs with any share of agreeing matches take part, and up to which each placed photo is
/// reconsidered.
const FEW: usize = 8;
/// Focal lengths by which photos without a scene are checked for a rotation on the spot.
const POSSIBLE: [f64; 6] = [0.5, 0.65, 0.8, USUAL, 1.2, 1.6];
/// Initial pairs that are tried, and the most photos for which further ones are tried after the first has reached all.
const BEGINNINGS: usize = 6;
const SEVERAL: usize = 12;
/// Further focal lengths are tried as long as the best scene's own differs from every tried one by more than this, in
/// the logarithm; and the most that are tried.
const ANOTHER: f64 = 0.04;
const TRIED: usize = 4;
/// Two scenes confirm each other if the support of the lesser is at least this part of the better one's.
const ALIKE: f64 = 0.9;
/// Shares of the matches of a pair that must agree where there are many photos. Without the lower one, the first growth
/// led kitchen 20 degrees astray in place of 0.2. Two shares, since a wrong pair that misleads one scene need not be
/// part of the other.
const CERTAIN: [f64; 2] = [0.5, 0.65];
/// Rotations farther apart than this are different, radians: while scenes grow, adjusted only roughly, and once they
/// are settled. Two explanations differ if one of so many photos does: a single wrong photo is no other explanation.
const GROWN_APART: f64 = 0.1;
const DIFFERENT: f64 = 0.035;
const ONE_IN: usize = 8;

/// The scene that was found.
pub(crate) struct Scene {
    /// Cameras and points, and a mask of the photos that have a place.
    pub found: Option<(Bundle, Vec<bool>)>,
    pub pairs: Pairs,
    /// Support of the best explanation that differs, over the support of the chosen one.
    pub rival: f64,
    /// Photos tied to the rest only by pairs that may be chance, or whose place is contradicted by matches with the
    /// rest.
    pub untied: Vec<usize>,
    /// True if there is no scene because the photos were taken by rotating on the spot.
    pub one_place: bool,
}

impl Scene {
    fn none(pairs: Pairs) -> Self {
        Self { found: None, pairs, rival: 0.0, untied: Vec::new(), one_place: false }
    }
}

/// A search for the best scene.
pub(crate) struct Search<'a> {
    taken: &'a [Taken],
    features: &'a [Features],
    photos: &'a [&'a Photo<'a>],
    settings: &'a EstimateOptions,
    pairs: Pairs,
    /// The scenes that were grown.
    found: Vec<Grown>,
    /// Support of the best of the scenes that were given up while they were small, over the support of the kept one.
    given_up: f64,
    /// Learned matches: these keypoints cannot be matched anew along epipolar lines.
    learned: Vec<Compared>,
}

impl<'a> Search<'a> {
    pub fn new(
        taken: &'a [Taken],
        photos: &'a [&'a Photo<'a>],
        features: &'a [Features],
        settings: &'a EstimateOptions,
    ) -> Self {
        let candidates = pairs::compared(features, taken, &vec![true; taken.len()], settings);
        let matched = pairs::matched(features, &candidates);
        let pairs = Pairs { matched, posed: Vec::new() };
        Self::among(taken, photos, features, settings, pairs, Vec::new())
    }

    /// A search by known matches; some may be `learned`.
    pub fn among(
        taken: &'a [Taken],
        photos: &'a [&'a Photo<'a>],
        features: &'a [Features],
        settings: &'a EstimateOptions,
        pairs: Pairs,
        learned: Vec<Compared>,
    ) -> Self {
        Self { taken, features, photos, settings, pairs, found: Vec::new(), given_up: 0.0, learned }
    }

    /// The scene with the largest support.
    pub fn scene(mut self) -> Scene {
        self.run();
        let different = self.different();
        // A single explanation of many photos is not settled if their matches are many more than they need: there is
        // nothing to compare it with.
        let compared = different.len() > 1 || different.iter().any(|i| !self.found[*i].bundle.has_plenty());
        let settled = |i: usize| if compared { self.settled(&self.found[i]) } else { self.found[i].clone() };
        let mut settled: Vec<Grown> = different.into_iter().map(settled).collect();
        let Some(best) = best(&settled) else { return self.without_cameras() };
        // Settling can bring different beginnings to the same end.
        let others = settled.iter().filter(|other| settled[best].differs(other, DIFFERENT));
        let rival = others.map(|other| other.support / settled[best].support).fold(self.given_up, f64::max);
        let Grown { mut bundle, mut placed, .. } = settled.swap_remove(best);
        self.finish(&mut bundle, &placed, compared);
        // Photos from one place can make a scene, too, but its depths are undetermined.
        if self.one_place(&bundle, &placed) {
            return Scene { one_place: true, ..Scene::none(self.pairs) };
        }
        // The last passes may have left a camera with too few observations.
        let seen = bundle.summed(bundle.seen());
        placed.iter_mut().zip(seen).for_each(|(placed, seen)| *placed &= seen >= LEAST_SEEN);
        bundle.observations.retain(|o| placed[o.camera]);
        if !placed.contains(&true) {
            return self.without_cameras();
        }
        bundle.finish();
        let agreeing = |pair: &Pair| agreeing(self.features, pair, &pair.photos.map(|photo| bundle.camera(photo)));
        let untied = untied(&self.pairs.posed, &placed, |photo| bundle.mounted(photo).on, agreeing);
        Scene { found: Some((bundle, placed)), rival, untied, ..Scene::none(self.pairs) }
    }

    /// No scene. Without a scene the focal length is unknown, so that a rotation by any possible one counts.
    fn without_cameras(self) -> Scene {
        let all = vec![true; self.taken.len()];
        let of = |factor: &f64| self.one_place(&self.settings.bundle(self.taken, *factor), &all);
        Scene { one_place: POSSIBLE.iter().any(of), ..Scene::none(self.pairs) }
    }

    /// True if the photos with a place were taken by rotating on the spot.
    fn one_place(&self, bundle: &Bundle, placed: &[bool]) -> bool {
        turning(self.features, &self.pairs.posed, bundle, placed, tau(self.taken))
    }

    /// Grows scenes.
    fn run(&mut self) {
        if self.taken.len() > MANY {
            return self.run_many();
        }
        let few = self.taken.len() <= FEW;
        let tau = tau(self.taken);
        let mut waiting = self.focal_lengths(tau);
        let mut tried: Vec<f64> = Vec::new();
        // The focal length that each scene began with.
        let mut began: Vec<f64> = Vec::new();
        while !waiting.is_empty() {
            let factor = waiting.remove(0);
            let bundle = self.settings.bundle(self.taken, factor);
            let posed = pairs::posed(self.features, &bundle.cameras, &self.pairs.matched, tau);
            // Among many photos, pairs by chance do more harm than right but doubtful pairs do good.
            let certain: &[f64] = if few { &[0.0] } else { &CERTAIN };
            certain.iter().for_each(|share| self.grow(&bundle, &posed, *share));
            tried.push(factor);
            let best = best(&self.found);
            // The pairs that led to the best scene are kept.
            if best.is_none_or(|best| best >= began.len()) {
                self.pairs.posed = posed;
            }
            began.resize(self.found.len(), factor);
            // Poses of pairs are as wrong as the focal length that they were found by: the adjusted one of the best
            // scene may do better.
            let again = !self.focal_known() && waiting.is_empty() && tried.len() < TRIED && self.taken.len() <= SEVERAL;
            let found = best.filter(|_| again).map(|best| began[best] * self.found[best].focal_factor());
            waiting.extend(found.filter(|found| tried.iter().all(|tried| (found / tried).ln().abs() > ANOTHER)));
        }
    }

    /// Grows scenes from the pairs with at least this share of agreeing matches.
    fn grow(&mut self, bundle: &Bundle, posed: &[Pair], share: f64) {
        let few = self.taken.len() <= FEW;
        let absent = vec![false; self.taken.len()];
        let certain: Vec<Pair> = posed.iter().filter(|pair| few || pair.certain(share)).cloned().collect();
        let all_tracks = linked(self.features, posed);
        let tracks = linked(self.features, &certain);
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
            // Among many photos, the next initial pair is one that the other scenes did not reach.
            let reached = |grown: &Grown| from.photos.iter().all(|p| grown.placed[*p]);
            if tried == BEGINNINGS || self.taken.len() > SEVERAL && self.found[first..].iter().any(reached) {
                continue;
            }
            tried += 1;
            for pose in std::iter::once(&from.pose).chain(&from.rival) {
                // Two initial pairs that lead to the same best scene are enough.
                if confirmed(&self.found, first) {
                    return;
                }
                let mut grown = Grown::new(bundle.clone(), from.photos, pose);
                grown.grow(&evidence);
                if !few {
                    // Doubtful pairs join once the certain ones have fixed the scene; they must then agree with its
                    // points.
                    grown.grow(&all);
                }
                self.found.push(grown);
            }
        }
    }

    /// True if any photo has a given focal length.
    fn focal_known(&self) -> bool {
        self.taken.iter().any(|t| t.focal.is_some())
    }

    /// Focal lengths to begin with, over the longer side: the usual one if any is given, else the ones that pairs vote
    /// for.
    fn focal_lengths(&self, tau: f64) -> Vec<f64> {
        if self.focal_known() {
            // The lenses of all photos then follow from the given focal lengths, and this factor is not used.
            return vec![USUAL];
        }
        let usual = self.settings.bundle(self.taken, USUAL).cameras;
        let voted = focal::voted(self.features, &usual, &self.pairs.matched, tau);
        let mut voted: Vec<f64> = voted.into_iter().map(|f| f * USUAL).collect();
        voted.truncate(FOCAL_LENGTHS);
        if voted.is_empty() { vec![USUAL] } else { voted }
    }
}

/// The number of the scene with the largest value.
fn best(scenes: &[Grown]) -> Option<usize> {
    (0..scenes.len()).reduce(|a, b| if scenes[b].value() > scenes[a].value() { b } else { a })
}

/// True if another scene confirms the best one, and one of both is among the scenes from `first` on.
fn confirmed(found: &[Grown], first: usize) -> bool {
    let Some(best) = best(found) else { return false };
    let alike = |other: &Grown| {
        other.value().0 == found[best].value().0
            && other.support > ALIKE * found[best].support
            && !found[best].differs(other, GROWN_APART)
    };
    (0..found.len()).any(|i| i != best && i.max(best) >= first && alike(&found[i]))
}

impl Grown {
    /// Number of photos with a place, then the support.
    fn value(&self) -> (usize, f64) {
        (self.placed.iter().filter(|placed| **placed).count(), self.support)
    }

    /// Factor on the focal length of the first photo with a place.
    fn focal_factor(&self) -> f64 {
        let first = self.placed.iter().position(|placed| *placed);
        first.map_or(1.0, |first| self.bundle.lenses[self.bundle.lens_of[first]].log_focal.exp())
    }

    /// True if enough photos are rotated differently relative to the rest, by more than `least` radians.
    fn differs(&self, other: &Self, least: f64) -> bool {
        let both: Vec<usize> = (0..self.placed.len()).filter(|i| self.placed[*i] && other.placed[*i]).collect();
        let turn =
            |bundle: &Bundle, i: usize, from: usize| bundle.cameras[i].pose.relative_to(&bundle.cameras[from].pose);
        let turned =
            |i: usize, from: usize| turn(&self.bundle, i, from).angle_to(&turn(&other.bundle, i, from)) > least;
        // Relative to the photo that most others agree with, so that a rotation of the world does not count.
        let fewest = both.iter().map(|from| both.iter().filter(|i| turned(**i, *from)).count()).min();
        fewest.is_some_and(|fewest| fewest > 0 && fewest * ONE_IN >= both.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::glam::{DMat3, DVec3};
    use weaver_geometry::{Camera, Intrinsics, Pose};

    /// Sixteen photos in a rotated world; the photos in `turned` are rotated in addition.
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

    /// Explanations differ by photos and not by their world.
    #[test]
    fn explanations_differ_by_photos() {
        let first = grown(&[], 0.0);
        assert!(!first.differs(&grown(&[], 0.7), DIFFERENT));
        assert!(!first.differs(&grown(&[0], 0.7), DIFFERENT), "one of many");
        assert!(first.differs(&grown(&[0, 9], 0.7), DIFFERENT) && grown(&[0, 9], 0.7).differs(&first, DIFFERENT));
        assert!(!first.differs(&grown(&[0, 9], 0.7), 3.0 * DIFFERENT), "by little");
    }

    /// More photos with a place count before what these explain.
    #[test]
    fn the_best_scene_places_most_photos() {
        let with = |placed: usize, support: f64| {
            let placed = (0..16).map(|i| i < placed).collect();
            Grown { placed, support, ..grown(&[], 0.0) }
        };
        assert_eq!(best(&[]), None);
        assert_eq!(best(&[with(4, 9.0), with(5, 1.0), with(5, 2.0), with(2, 99.0)]), Some(2));
        assert_eq!(best(&[with(5, 2.0), with(5, 2.0)]), Some(0), "the first of equal ones");
    }

    #[test]
    fn scenes_confirm_each_other_where_they_agree() {
        let with = |turned: &[usize], support: f64| Grown { support, ..grown(turned, 0.4) };
        let unlike = [0, 4, 8, 12];
        // `DIFFERENT` turns are less than what tells growing scenes apart.
        assert!(confirmed(&[with(&[], 1.0), with(&unlike, 0.95)], 0));
        assert!(confirmed(&[with(&[], 1.0), with(&[], 0.95)], 1));
        assert!(!confirmed(&[with(&[], 1.0), with(&[], 0.95)], 2), "neither is new");
        assert!(!confirmed(&[with(&[], 1.0), with(&[], 0.85)], 0), "one explains much less");
        assert!(!confirmed(&[with(&[], 1.0)], 0) && !confirmed(&[], 0));
        let fewer = Grown { placed: (0..16).map(|i| i < 15).collect(), ..grown(&[], 0.0) };
        assert!(!confirmed(&[with(&[], 1.0), fewer], 0), "one places fewer photos");
    }

    #[test]
    fn the_first_placed_photo_has_the_focal_length() {
        let lens = |log_focal| crate::bundle::Lens { log_focal, ..Default::default() };
        let mut scene = grown(&[], 0.0);
        scene.bundle.lenses = vec![lens(0.5), lens(-0.25)];
        scene.bundle.lens_of = (0..16).map(|i| i % 2).collect();
        assert_eq!(scene.focal_factor(), 0.5_f64.exp());
        scene.placed[0] = false;
        assert_eq!(scene.focal_factor(), (-0.25_f64).exp());
        scene.placed.fill(false);
        assert_eq!(scene.focal_factor(), 1.0);
    }
}
