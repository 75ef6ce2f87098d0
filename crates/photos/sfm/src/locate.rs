//! Photos that are only located, in the scene of the others.

use crate::bundle::{Bundle, LARGE};
use crate::evidence::{Evidence, Trust};
use crate::features::Features;
use crate::grow::Grown;
use crate::lenses::{Taken, tau};
use crate::pairs::{self, Pairs, linked};
use crate::passes::{Pass, compared, near};
use crate::photo::EstimateOptions;

/// Largest error of a place by pairs alone, in deviations of keypoints.
const ASTRAY: f64 = 32.0;

/// The scene of some photos.
pub(crate) struct SceneOfSome<'a> {
    /// Numbers of these photos among all, ascending.
    pub numbers: &'a [usize],
    pub bundle: Bundle,
    /// True for the ones with a place.
    pub placed: &'a [bool],
}

/// The cameras of all photos, the scene's as they are; which have a place; and what pairs say, also of photos that are
/// only located.
pub(crate) fn locate(
    taken: &[Taken],
    features: &[Features],
    settings: &EstimateOptions,
    scene: SceneOfSome<'_>,
    mut pairs: Pairs,
) -> (Bundle, Vec<bool>, Pairs) {
    let SceneOfSome { numbers, bundle, placed: in_scene } = scene;
    let mut placed = vec![false; taken.len()];
    numbers.iter().zip(in_scene).for_each(|(photo, in_scene)| placed[*photo] = *in_scene);
    let mut bundle = bundle.among(numbers, taken);
    if numbers.len() == taken.len() {
        return (bundle, placed, pairs);
    }
    let others: Vec<bool> = (0..taken.len()).map(|i| numbers.binary_search(&i).is_ok()).collect();
    let mut with_located = pairs::compared(features, taken, &others, settings);
    with_located.retain(|pair| pair.iter().any(|photo| !others[*photo]));
    let cameras: Vec<_> = (0..taken.len()).map(|i| bundle.camera(i)).collect();
    let matched = pairs::matched(features, &with_located);
    pairs.posed.extend(pairs::posed(features, &cameras, &matched, tau(taken)));
    pairs.matched.extend(matched);
    let tracks = linked(features, &pairs.posed);
    // Other photos without a place get none here.
    let evidence = Evidence { features, pairs: &pairs.posed, tracks: &tracks, absent: &others, trust: Trust::PAIRS };
    let before = placed.clone();
    let mut found = Grown { bundle: bundle.clone(), placed: before.clone(), support: 0.0 };
    found.bundle.lenses.iter_mut().for_each(|lens| *lens = lens.held());
    found.join(&evidence);
    let mut near = near(&found.bundle, &found.placed, settings.candidates);
    let located: Vec<bool> = before.iter().map(|placed| !placed).collect();
    if taken.len() > LARGE {
        // Matches with a photo that is located tie the others' keypoints, too: where photos are many these are enough,
        // and all others take as long as the scene itself took.
        near.retain(|pair| pair.iter().any(|photo| located[*photo]));
    }
    found.bundle.fixed = before;
    // Pairs alone can put a photo a few degrees off: right matches are then far from epipolar lines.
    let passes = std::iter::once(Pass::wide(ASTRAY)).chain(Pass::FINE);
    passes.for_each(|pass| found.bundle.pass(features, compared(&near), &located, &pass));
    bundle.cameras = found.bundle.cameras;
    (bundle, found.placed, pairs)
}
