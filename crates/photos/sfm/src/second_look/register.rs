//! Photos that are left out, registered in a scene that stays as it is.

use super::extended::{Extended, Matched};
use super::{Given, PairMatcher};
use crate::bundle::{Bundle, LARGE};
use crate::epipolar::Epipolar;
use crate::evidence::{Evidence, FITS, Trust};
use crate::features::Features;
use crate::grow::Grown;
use crate::lenses::tau;
use crate::pairs::{self, Pair, Pairs};
use crate::passes::{Compared, Pass, compared, near, sharpest};
use crate::place::tally;
use crate::tracks::{Track, joined};
use crate::triangulation::error;
use std::collections::BTreeSet;

/// Photos before and after a photo that are looked at with it, and photos in all.
const BESIDE: usize = 4;
const PARTNERS: usize = 16;
/// Pairs that are matched again for each photo, at most.
const PAIRS: usize = 6;
/// Cameras near each other whose learned keypoints are compared, so that they become points.
const NEAR: usize = 8;
/// Rounds of placing photos by photos that were placed.
const ROUNDS: usize = 5;
/// The share of its matches with placed photos, and of the points in its view, that must agree with a photo's place.
const AGREE: f64 = 0.6;
/// Points that a registered photo must see at least, and their largest error in deviations of keypoints.
const LEAST_SEEN: usize = 25;
const CERTAIN: f64 = 3.0;

/// Places photos without a camera by learned matches, in a scene whose cameras stay as they are to the bit, and
/// marks them in `placed`.
pub(crate) fn register(
    given: Given<'_>,
    matcher: &dyn PairMatcher,
    bundle: &mut Bundle,
    placed: &mut [bool],
    pairs: &mut Pairs,
) {
    let Given { taken, photos, features, settings } = given;
    let missing: Vec<bool> = (0..placed.len()).map(|i| !placed[i] && taken[i].mounted.is_none()).collect();
    if !missing.contains(&true) || !placed.contains(&true) {
        return;
    }
    let looked_at = partners(&missing, pairs);
    let wanted: Vec<bool> =
        (0..placed.len()).map(|i| missing[i] || looked_at.iter().any(|pair| pair.contains(&i))).collect();
    let all = Extended::new(features, photos, &wanted, matcher);
    let found = all.matched(&all.promising(&looked_at, &missing, PAIRS), matcher);
    let cameras: Vec<_> = (0..taken.len()).map(|i| bundle.camera(i)).collect();
    let learned = pairs::posed(&all.features, &cameras, &found, tau(taken));
    let known = known(&all, bundle, placed, &learned);
    let every: Vec<Pair> = pairs.posed.iter().chain(&learned).cloned().collect();
    let counts: Vec<usize> = all.features.iter().map(|f| f.keypoints.len()).collect();
    let of_pairs = every.iter().map(|pair| (pair.photos, &pair.matches[..]));
    let tracks = joined(&counts, of_pairs.chain(known.iter().map(|(pair, matches)| (*pair, &matches[..]))));
    let mut absent: Vec<bool> = missing.iter().map(|missing| !missing).collect();
    let mut held = Grown { bundle: bundle.clone(), placed: placed.to_vec(), support: 0.0 };
    held.bundle.lenses.iter_mut().for_each(|lens| *lens = lens.held());
    for _ in 0..ROUNDS {
        let evidence =
            Evidence { features: &all.features, pairs: &every, tracks: &tracks, absent: &absent, trust: Trust::POINTS };
        let before = held.placed.clone();
        held.join(&evidence);
        let new: Vec<usize> = (0..before.len()).filter(|i| held.placed[*i] && !before[*i]).collect();
        if new.is_empty() {
            break;
        }
        let agrees = |held: &Grown, photo: usize| {
            let [agree, all] = tally(&evidence, &held.bundle, &before, &held.bundle.cameras[photo].pose, photo);
            agree as f64 >= AGREE * all as f64
        };
        let wrong: Vec<usize> = new.into_iter().filter(|photo| !agrees(&held, *photo)).collect();
        for photo in wrong {
            (held.placed[photo], absent[photo]) = (false, true);
        }
    }
    let new: Vec<bool> = (0..placed.len()).map(|i| held.placed[i] && !placed[i]).collect();
    if !new.contains(&true) {
        return;
    }
    let mut again: Vec<Compared> = compared(&near(&held.bundle, &held.placed, settings.candidates));
    if taken.len() > LARGE {
        again.retain(|(pair, _)| pair.iter().any(|photo| new[*photo]));
    }
    let of_placed = |pair: &[usize; 2]| pair.iter().all(|photo| held.placed[*photo]);
    again.extend(learned.iter().filter(|pair| of_placed(&pair.photos)).map(|pair| (pair.photos, pair.matches.clone())));
    again.extend(known.iter().cloned());
    held.bundle.fixed = placed.to_vec();
    for pass in Pass::FINE {
        held.bundle.pass(&all.features, again.clone(), &new, &pass);
    }
    let certain = certain(&held.bundle, &all.features, &tracks, &new);
    for photo in (0..new.len()).filter(|i| new[*i] && certain[*i]) {
        bundle.cameras[photo] = held.bundle.cameras[photo];
        placed[photo] = true;
    }
    pairs.posed.extend(learned);
}

/// Pairs of each missing photo with others that may show the same: those beside it in the order of the photos, those
/// that own features find something in common with, and, of few photos, all.
fn partners(missing: &[bool], pairs: &Pairs) -> Vec<[usize; 2]> {
    let n = missing.len();
    let mut chosen = BTreeSet::new();
    for photo in (0..n).filter(|photo| missing[*photo]) {
        let beside = (1..=BESIDE).flat_map(|step| [photo.checked_sub(step), Some(photo + step)]).flatten();
        let mut others: Vec<usize> = beside.filter(|other| *other < n).collect();
        let mut own: Vec<(usize, usize)> = (pairs.posed.iter())
            .filter(|pair| pair.photos.contains(&photo))
            .map(|pair| (pair.matches.len(), pair.photos[0] + pair.photos[1] - photo))
            .collect();
        own.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        others.extend(own.into_iter().map(|(_, other)| other));
        others.extend(pairs.matched.iter().filter(|(pair, _)| pair.contains(&photo)).map(|([a, b], _)| a + b - photo));
        // Evenly spread ones after that.
        let step = n.div_ceil(PARTNERS).max(1);
        others.extend((0..n).step_by(step).filter(|other| *other != photo));
        let mut of_photo = Vec::new();
        for other in others {
            if of_photo.len() < PARTNERS && !of_photo.contains(&other) {
                of_photo.push(other);
            }
        }
        chosen.extend(of_photo.into_iter().map(|other| [photo.min(other), photo.max(other)]));
    }
    chosen.into_iter().collect()
}

/// Matches between placed photos, where cameras are known: by descriptors, near epipolar lines.
fn known(all: &Extended, bundle: &Bundle, placed: &[bool], learned: &[Pair]) -> Vec<Matched> {
    let part = |photo: usize| placed[photo] && learned.iter().any(|pair| pair.photos.contains(&photo));
    let of_part: Vec<bool> = (0..placed.len()).map(part).collect();
    let mut found = all.nearest_matched(&near(bundle, &of_part, NEAR));
    for ([a, b], matches) in &mut found {
        let [from, to] = [bundle.camera(*a), bundle.camera(*b)];
        let epipolar = Epipolar::new(&from, &to, FITS * sharpest(&to));
        let pixel = |photo: usize, keypoint: usize| {
            let lens = &bundle.lenses[bundle.lens_of[photo]];
            lens.undistort(&bundle.cameras[photo], all.features[photo].keypoints[keypoint].pixel)
        };
        matches.retain(|m| {
            let [first, second] = m.numbers();
            epipolar.allows(pixel(*a, first), pixel(*b, second))
        });
    }
    found.retain(|(_, matches)| !matches.is_empty());
    found
}

/// True for new photos that see enough points of the others where these are.
fn certain(bundle: &Bundle, features: &[Features], tracks: &[Track], new: &[bool]) -> Vec<bool> {
    let mut bundle = bundle.clone();
    let all = bundle.observe(features, tracks, new, 2.0 * FITS);
    bundle.observations = all.iter().filter(|o| !new[o.camera]).copied().collect();
    let agreed = bundle.agreed();
    let mut counts = vec![[0_usize; 2]; new.len()];
    for o in all.iter().filter(|o| new[o.camera] && agreed[o.point]) {
        let pixel = bundle.lenses[bundle.lens_of[o.camera]].undistort(&bundle.cameras[o.camera], o.pixel);
        let fits = error(&bundle.camera(o.camera), bundle.points[o.point], pixel) < CERTAIN * o.deviation;
        counts[o.camera][0] += usize::from(fits);
        counts[o.camera][1] += 1;
    }
    counts.iter().map(|[fit, all]| *fit >= LEAST_SEEN && *fit as f64 >= AGREE * *all as f64).collect()
}
