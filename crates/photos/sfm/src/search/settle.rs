//! Explanations that are settled, so that they can be compared.

use super::{FEW, SEVERAL, Search};
use crate::bundle::Bundle;
use crate::evidence::{Evidence, Trust};
use crate::grow::{Grown, explained};
use crate::pairs::{Pair, linked};
use crate::passes::{Pass, compared, near};
use weaver_geometry::Pose;

/// Most explanations that are settled, for few photos and for more; and the least support and the least number of
/// placed photos of a settled one, as parts of the best one's.
const SETTLED: [usize; 2] = [4, 2];
const NEARLY: f64 = 0.6;
const NEARLY_ALL: f64 = 0.9;
/// Before they are settled, scenes are different if photos are rotated by more than this, radians: more than afterward,
/// as they are not adjusted finely yet.
const APART: f64 = 0.05;
/// The share of the matches of a pair that must agree for it to tie photos that look in different directions.
const CERTAIN: f64 = 0.5;
/// A photo is placed anew if the others rotate it by more than this, radians, and the support grows by this factor.
const ASTRAY: f64 = 0.007;
const BETTER: f64 = 1.005;
/// Scales of adjustments after an alignment, and the limit of outliers after each, in deviations: three scales, as
/// after any other adjustment.
const ALIGNING: [(f64, f64); 2] = [(2.0, 6.0), (1.0, 3.0)];
const STEPS: usize = 40;

impl Search<'_> {
    /// The different scenes with nearly the support of the best one, the best first.
    pub(super) fn different(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.found.len()).collect();
        let value = |i: &usize| self.found[*i].value();
        order.sort_by(|a, b| value(b).0.cmp(&value(a).0).then(value(b).1.total_cmp(&value(a).1)));
        let most = SETTLED[usize::from(self.taken.len() > SEVERAL)];
        let mut kept: Vec<usize> = Vec::new();
        for i in order {
            let (count, support) = kept.first().map_or(value(&i), value);
            // Settling costs a whole adjustment, so that clearly worse scenes are not worth it.
            let near = value(&i).0 as f64 >= NEARLY_ALL * count as f64 && value(&i).1 >= NEARLY * support;
            if near && kept.len() < most && kept.iter().all(|k| self.found[*k].differs(&self.found[i], APART)) {
                kept.push(i);
            }
        }
        kept
    }

    /// The scene with all points that its photos share, and its support.
    pub(super) fn settled(&self, grown: &Grown) -> Grown {
        let mut grown = grown.clone();
        if self.taken.len() <= FEW {
            self.reconsider(&mut grown);
        }
        let Grown { bundle, placed, support } = &mut grown;
        let free: Vec<bool> = bundle.lenses.iter().map(|lens| lens.free_focal).collect();
        bundle.free_focal(&free, placed);
        self.pass(bundle, placed, &Pass::FINE[0], false);
        self.align(bundle);
        *support = explained(bundle);
        grown
    }

    /// Finds the distortion, and all points that photos share once it is known; also before, if a scene was not
    /// settled.
    pub(super) fn finish(&self, bundle: &mut Bundle, placed: &[bool], settled: bool) {
        let free: Vec<bool> = bundle.lenses.iter().map(|lens| lens.free_focal).collect();
        bundle.free_focal(&free, placed);
        if bundle.free_distortion(self.settings.distortion, placed) || !settled {
            // An observation rejected at the margins may be right.
            self.pass(bundle, placed, &Pass::FINE[0], !settled);
        }
        self.pass(bundle, placed, &Pass::FINE[1].once_more(), false);
        bundle.finish();
        self.align(bundle);
        bundle.adjust(ALIGNING[1].0, STEPS);
        bundle.finish();
    }

    /// Matches and adjusts once: photos whose cameras stand near each other, and the photos of certain pairs. If their
    /// matches are `known`, these pairs are not matched again.
    fn pass(&self, bundle: &mut Bundle, placed: &[bool], pass: &Pass, known: bool) {
        let missing: Vec<bool> = placed.iter().map(|placed| !placed).collect();
        let mut pairs = compared(&near(bundle, placed, self.settings.candidates));
        let of_placed = |pair: &&Pair| pair.certain(CERTAIN) && pair.photos.iter().all(|photo| placed[*photo]);
        let matches = |pair: &Pair| if known { pair.matches.clone() } else { Vec::new() };
        pairs.extend(self.pairs.posed.iter().filter(of_placed).map(|pair| (pair.photos, matches(pair))));
        pairs.sort_by_key(|(photos, matches)| (*photos, matches.is_empty()));
        pairs.dedup_by_key(|(photos, _)| *photos);
        pairs.extend(self.learned.iter().filter(|(photos, _)| photos.iter().all(|photo| placed[*photo])).cloned());
        bundle.pass(self.features, pairs, &missing, pass);
    }

    /// Aligns the surroundings of keypoints, and adjusts to their new places.
    fn align(&self, bundle: &mut Bundle) {
        bundle.align(self.photos);
        for (scale, farthest) in ALIGNING {
            bundle.adjust_roughly(scale, STEPS);
            bundle.leave_out(farthest);
        }
        bundle.finish();
    }

    /// True for a photo that stands alone, or is the first of its rig.
    fn leads(&self, photo: usize) -> bool {
        self.taken[photo].mounted.is_none_or(|mounted| mounted.on == photo)
    }

    /// Takes photo after photo out, and places it anew by the others if the support grows by that.
    ///
    /// The first photos of a scene were never placed by the others, and one photo with a small wrong rotation bends
    /// many points after it.
    fn reconsider(&self, grown: &mut Grown) {
        let absent = vec![false; self.taken.len()];
        let features = self.features;
        let pairs = &self.pairs.posed[..];
        let tracks = linked(features, pairs);
        let evidence = Evidence { features, pairs, tracks: &tracks, absent: &absent, trust: Trust::POINTS };
        let free: Vec<bool> = grown.bundle.lenses.iter().map(|lens| lens.free_focal).collect();
        grown.bundle.free_focal(&free, &grown.placed);
        for photo in (0..self.taken.len()).filter(|photo| self.leads(*photo)) {
            if let Some(mut other) = grown.without(photo) {
                other.adjust(&evidence);
                other.rejoin(&evidence, photo);
                // A photo that returns to its old place is not adjusted again.
                if other.placed[photo] && turned(&grown.bundle, &other.bundle, photo, &grown.placed) > ASTRAY {
                    other.adjust(&evidence);
                    if other.support > BETTER * grown.support {
                        *grown = other;
                    }
                }
            }
        }
        grown.bundle.lenses.iter_mut().zip(free).for_each(|(lens, free)| lens.free_focal = free);
    }
}

/// Rotation of a photo in one scene relative to the other, as seen from the first of the others, radians.
fn turned(one: &Bundle, other: &Bundle, photo: usize, placed: &[bool]) -> f64 {
    let first = (0..placed.len()).find(|i| placed[*i] && *i != photo).unwrap_or(photo);
    let turn = |bundle: &Bundle| -> Pose { bundle.cameras[photo].pose.relative_to(&bundle.cameras[first].pose) };
    turn(one).angle_to(&turn(other))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::Features;
    use crate::lenses::Taken;
    use crate::photo::{EstimateOptions, Photo};
    use weaver_geometry::glam::DMat3;
    use weaver_procedural::{ProceduralOptions, scene};

    /// Runs a search of six drawn photos.
    fn with_search<T>(run: impl FnOnce(Search<'_>) -> T) -> T {
        let drawn = scene(3, &ProceduralOptions { width: 192, height: 144, views: 12 });
        let photo = |view: &weaver_data::View| Photo::new(view.image.to_bytes(), [144, 192]);
        let photos: Vec<Photo<'_>> = drawn.views.iter().step_by(2).map(photo).collect();
        let features: Vec<Features> = photos.iter().map(|photo| photo.features(1000)).collect();
        let taken = photos.iter().map(Taken::of).collect::<Vec<_>>();
        let settings = EstimateOptions::default();
        let photos: Vec<&Photo<'_>> = photos.iter().collect();
        run(Search::new(&taken, &photos, &features, &settings))
    }

    /// The same scene with a rotated photo, and this support.
    fn but(grown: &Grown, photo: usize, angle: f64, support: f64) -> Grown {
        let mut other = Grown { support, ..grown.clone() };
        let pose = &mut other.bundle.cameras[photo].pose;
        let center = pose.center();
        let rotation = DMat3::from_rotation_y(angle) * pose.rotation;
        *pose = Pose::new(rotation, -(rotation * center));
        other
    }

    /// Promise of `only_other_explanations_are_settled`.
    #[test]
    fn a_photo_that_is_turned_is_turned_back() {
        with_search(|mut search| {
            search.run();
            let right = search.found[search.different()[0]].clone();
            assert_eq!(right.value().0, 6);
            for photo in [0, 3] {
                let mut grown = but(&right, photo, 0.15, 0.5 * right.support);
                assert!(turned(&right.bundle, &grown.bundle, photo, &right.placed) > 0.1);
                search.reconsider(&mut grown);
                let left = turned(&right.bundle, &grown.bundle, photo, &right.placed);
                assert!(left < 0.1 * 0.15 && grown.support > 0.9 * right.support, "{photo}: {left}, {}", grown.support);
            }
            let mut same = right.clone();
            search.reconsider(&mut same);
            assert!(same.support >= right.support);
        });
    }

    /// Promise (figures): explanations are compared once each has come to its end.
    #[test]
    fn only_other_explanations_are_settled() {
        with_search(|mut search| {
            search.run();
            let right = search.found[search.different()[0]].clone();
            search.found = vec![
                but(&right, 1, 0.3, 0.7 * right.support),
                but(&right, 2, 0.01, 0.9 * right.support),
                right.clone(),
                but(&right, 4, 0.3, 0.5 * right.support),
            ];
            assert_eq!(search.different(), [2, 0]);
            let settled = search.settled(&right);
            let aligned = settled.bundle.observations.iter().filter(|o| o.deviation < 0.5).count();
            assert!(2 * aligned > settled.bundle.observations.len(), "{aligned}");
            // A photo turned by hand is turned back, and so comes to the same end.
            let turned_back = search.settled(&search.found[0]);
            assert!(turned_back.support > 0.95 * settled.support);
            assert!(turned(&settled.bundle, &turned_back.bundle, 1, &right.placed) < 0.1 * 0.3);
        });
    }
}
