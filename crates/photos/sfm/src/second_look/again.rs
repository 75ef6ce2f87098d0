//! A scene that is looked for again, with learned matches beside the own ones.

use super::extended::Extended;
use super::{Given, PairMatcher};
use crate::confidence::Confidence;
use crate::pairs::Pairs;
use crate::search::{Scene, Search};
use weaver_geometry::Pose;

/// Photos up to which a whole scene is looked for again.
const MOST: usize = 30;
/// Pairs that are matched again for each photo, at most.
const PAIRS: usize = 5;
/// Matches from which on own features settle a pair, and the share of them that must agree.
const SETTLED: usize = 100;
const AGREE: f64 = 0.65;
/// Radians from which rotations of a photo in two scenes differ, and the part of the photos that must be turned alike.
const APART: f64 = 0.035;
const ALIKE: f64 = 0.9;

/// The scene by own and learned matches together; `None` of too many photos, of rigs, and where there is no new match.
pub(crate) fn again(given: Given<'_>, matcher: &dyn PairMatcher, first: &Scene) -> Option<Scene> {
    let Given { taken, photos, features, settings } = given;
    let n = taken.len();
    if n > MOST || taken.iter().any(|taken| taken.mounted.is_some()) {
        return None;
    }
    let everything = vec![true; n];
    let all = Extended::new(features, photos, &everything, matcher);
    let settled = |pair: &[usize; 2]| {
        let mut of_pair = first.pairs.posed.iter().filter(|posed| posed.photos == *pair);
        of_pair.any(|posed| posed.matches.len() >= SETTLED && posed.certain(AGREE))
    };
    let pairs = (0..n).flat_map(|a| (a + 1..n).map(move |b| [a, b]));
    let pairs: Vec<[usize; 2]> = pairs.filter(|pair| !settled(pair)).collect();
    let learned = all.matched(&all.promising(&pairs, &everything, PAIRS), matcher);
    if learned.is_empty() {
        return None;
    }
    let matched = first.pairs.matched.iter().chain(&learned).cloned().collect();
    let pairs = Pairs { matched, posed: Vec::new() };
    Some(Search::among(taken, photos, &all.features, settings, pairs, learned).scene())
}

/// A scene, and the confidence in it.
pub(crate) type Judged<'a> = (&'a Scene, Confidence);

/// True if a second scene takes the place of the first, which is no good one: if it is good and places as many photos,
/// or if it places more. Photos that the first was sure about must be turned alike in both, unless the second places
/// twice as many: else a second look would be a second chance for a wrong scene to seem good.
pub(crate) fn better((first, before): Judged<'_>, (second, after): Judged<'_>) -> bool {
    let placed = |scene: &Scene| scene.found.as_ref().map_or(0, |(_, placed)| placed.iter().filter(|p| **p).count());
    let [of_first, of_second] = [placed(first), placed(second)];
    let more = if after == Confidence::Good { of_second >= of_first } else { of_second > of_first && of_first > 0 };
    after != Confidence::None
        && before != Confidence::Good
        && more
        && (of_second >= 2 * of_first || alike(first, second))
}

/// True if nearly all photos that both place, and that the first does not call untied, are turned alike.
fn alike(first: &Scene, second: &Scene) -> bool {
    let (Some((a, of_first)), Some((b, of_second))) = (&first.found, &second.found) else { return false };
    let sure = |photo: &usize| of_first[*photo] && of_second[*photo] && !first.untied.contains(photo);
    let both: Vec<usize> = (0..of_first.len()).filter(sure).collect();
    let turn = |poses: [&Pose; 2]| poses[1].relative_to(poses[0]);
    let same = |i: usize, from: usize| {
        let [one, other] = [a, b].map(|bundle| turn([&bundle.cameras[from].pose, &bundle.cameras[i].pose]));
        one.angle_to(&other) <= APART
    };
    let most = both.iter().map(|from| both.iter().filter(|i| same(**i, *from)).count()).max();
    most.is_some_and(|most| most as f64 >= ALIKE * both.len() as f64)
}
