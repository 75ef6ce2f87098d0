//! Photos that may show the same things, for any number of photos.
//!
//! Descriptors of keypoints are quantized to words of a [`Vocabulary`] made for these very photos; photos that share
//! rare words come first. The largest keypoints of those are then matched, which separates chance from the same place.
//!
//! Sources: Sivic and Zisserman, Video Google: a text retrieval approach to object matching in videos, 2003; Nistér and
//! Stewénius, Scalable recognition with a vocabulary tree, 2006, for the words in two steps; Jégou, Douze and Schmid,
//! On the burstiness of visual elements, 2009, for the square roots of counts.

#[cfg(test)]
mod tests;
mod vocabulary;
mod words;

use crate::features::Features;
use crate::matching::matches;
use std::cmp::Reverse;
use std::collections::BTreeSet;
use vocabulary::Vocabulary;
use weaver_kernels::parallel;
use words::Index;

/// The largest keypoints of a photo, by which photos are compared roughly.
const COARSE: usize = 300;
/// Photos that are compared roughly, over the number of chosen ones.
const SHORTLIST: usize = 2;
/// Distances in a sequence at which photos are compared regardless of their similarity.
const STEPS: [usize; 4] = [1, 2, 4, 8];

/// Pairs of photos that may show the same things, ascending: all of them, or each photo with the `most` similar ones.
///
/// Photos that are not `present` are compared with the others, and change nothing for them. In a `sequence`, each photo
/// is compared with the ones 1, 2, 4 and 8 before and after it, and the rest of its `most` are chosen beyond them,
/// where a path may come back to the same place.
///
/// ```
/// use weaver_sfm::{Features, candidates};
/// let photos = vec![Features::default(); 4];
/// assert_eq!(candidates(&photos, &[true, true, true, false], 9, false).len(), 6);
/// ```
///
/// # Panics
/// If `present` is not as long as `features`.
pub fn candidates(features: &[Features], present: &[bool], most: usize, sequence: bool) -> Vec<[usize; 2]> {
    let n = features.len();
    assert_eq!(present.len(), n, "candidates: one flag for each photo");
    let inside: Vec<usize> = (0..n).filter(|i| present[*i]).collect();
    let pair = |a: usize, b: usize| [a.min(b), a.max(b)];
    if inside.len() <= most + 1 {
        let of = |a: usize| inside.iter().filter(move |b| **b != a).map(move |b| pair(a, *b));
        return (0..n).flat_map(of).collect::<BTreeSet<_>>().into_iter().collect();
    }
    let order = Order { inside: &inside, sequence };
    let mut pairs = BTreeSet::new();
    let mut wanted = vec![most; n];
    for (photo, wanted) in wanted.iter_mut().enumerate() {
        let near: Vec<usize> = order.near(photo).take(most).collect();
        *wanted -= near.len();
        pairs.extend(near.into_iter().map(|other| pair(photo, other)));
    }
    for (photo, alike) in alike(features, &order, &wanted).into_iter().enumerate() {
        pairs.extend(alike.into_iter().map(|other| pair(photo, other)));
    }
    pairs.into_iter().collect()
}

/// Further pairs, ascending, for a second round: of photos that have `verified` pairs with the same third one. At most
/// `most` for each photo, by falling number of matches (the fewer of both pairs with the third photo, summed over third
/// photos); none that was `tried`.
///
/// As in [`candidates`], photos that are not `present` change nothing for those that are.
///
/// Source: Chum, Philbin, Sivic, Isard and Zisserman, Total recall: automatic query expansion, 2007.
///
/// ```
/// use weaver_sfm::expansion;
/// let verified = [([0, 1], 80), ([1, 2], 40)];
/// assert_eq!(expansion(&[true; 3], &verified, &[[0, 1], [1, 2]], 5), [[0, 2]]);
/// ```
pub fn expansion(
    present: &[bool],
    verified: &[([usize; 2], usize)],
    tried: &[[usize; 2]],
    most: usize,
) -> Vec<[usize; 2]> {
    let n = present.len();
    let mut linked: Vec<Vec<(usize, usize)>> = vec![Vec::new(); n];
    for ([a, b], matches) in verified {
        linked[*a].push((*b, *matches));
        linked[*b].push((*a, *matches));
    }
    let tried: BTreeSet<[usize; 2]> = tried.iter().map(|[a, b]| [*a.min(b), *a.max(b)]).collect();
    let mut pairs = BTreeSet::new();
    let mut weight = vec![0; n];
    for photo in 0..n {
        let mut met = Vec::new();
        for (between, first) in linked[photo].iter().filter(|(between, _)| present[*between]) {
            for (other, second) in linked[*between].iter().filter(|(other, _)| present[*other] && *other != photo) {
                if weight[*other] == 0 {
                    met.push(*other);
                }
                weight[*other] += first.min(second);
            }
        }
        let new = |other: &usize| !tried.contains(&[photo.min(*other), photo.max(*other)]);
        let mut chosen: Vec<usize> = met.iter().copied().filter(new).collect();
        chosen.sort_unstable_by_key(|other| (Reverse(weight[*other]), *other));
        pairs.extend(chosen.into_iter().take(most).map(|other| [photo.min(other), photo.max(other)]));
        met.into_iter().for_each(|other| weight[other] = 0);
    }
    pairs.into_iter().collect()
}

/// The photos that are present, and a flag for a sequence.
struct Order<'a> {
    inside: &'a [usize],
    sequence: bool,
}

impl Order<'_> {
    /// The rank of the first photo behind `photo`, and of the last before it, plus one.
    fn around(&self, photo: usize) -> [usize; 2] {
        [self.inside.partition_point(|i| *i <= photo), self.inside.partition_point(|i| *i < photo)]
    }

    /// Photos that a photo is compared with for its place in the sequence, the nearest first.
    fn near(&self, photo: usize) -> impl Iterator<Item = usize> {
        let [behind, before] = self.around(photo);
        let steps = STEPS.iter().filter(|_| self.sequence);
        steps
            .flat_map(move |step| [before.checked_sub(*step), Some(behind + step - 1)])
            .filter_map(|rank| self.inside.get(rank?).copied())
    }

    /// True if a photo of a rank may be chosen by similarity: not the photo itself nor, in a sequence, one that is
    /// near.
    fn may_choose(&self, photo: usize, rank: usize) -> bool {
        let [behind, before] = self.around(photo);
        let reach = if self.sequence { STEPS[STEPS.len() - 1] } else { 0 };
        rank + reach < before || rank >= behind + reach
    }
}

/// For each photo the `wanted` most similar ones.
fn alike(features: &[Features], order: &Order<'_>, wanted: &[usize]) -> Vec<Vec<usize>> {
    let (n, inside) = (features.len(), order.inside);
    let vocabulary = Vocabulary::of(inside.iter().map(|i| &features[*i]));
    let mut counts = vec![Vec::new(); n];
    parallel::for_chunks(&mut counts, 1, |i, counts| counts[0] = vocabulary.counts(&features[i]));
    let index = Index::new(vocabulary.len(), inside.iter().map(|i| &counts[*i][..]));
    let mut shortlists: Vec<Vec<(usize, f32)>> = vec![Vec::new(); n];
    parallel::for_chunks(&mut shortlists, 1, |photo, shortlist| {
        let similar = index.similar(&counts[photo]);
        let ranks = (0..inside.len()).filter(|rank| order.may_choose(photo, *rank));
        shortlist[0] = best(ranks.map(|rank| (inside[rank], similar[rank])), SHORTLIST * wanted[photo]);
    });
    let mut pairs: Vec<([usize; 2], f32)> = (shortlists.iter().enumerate())
        .flat_map(|(a, list)| list.iter().map(move |(b, similar)| ([a.min(*b), a.max(*b)], *similar)))
        .collect();
    pairs.sort_unstable_by_key(|(pair, _)| *pair);
    pairs.dedup_by_key(|(pair, _)| *pair);
    let mut coarse = vec![Features::default(); n];
    parallel::for_chunks(&mut coarse, 1, |i, coarse| coarse[0] = features[i].largest(COARSE));
    parallel::for_chunks(&mut pairs, 1, |_, pair| {
        let ([a, b], similar) = &mut pair[0];
        *similar = matches(&coarse[*a], &coarse[*b]).len() as f32 * similar.sqrt();
    });
    let score = |a: usize, b: usize| {
        let found = pairs.binary_search_by_key(&[a.min(b), a.max(b)], |(pair, _)| *pair);
        pairs[found.expect("a pair of the shortlist")].1
    };
    (shortlists.iter().enumerate())
        .map(|(photo, list)| {
            let scored = list.iter().map(|(other, _)| (*other, score(photo, *other)));
            best(scored, wanted[photo]).into_iter().map(|(other, _)| other).collect()
        })
        .collect()
}

/// The `most` with the highest scores; of equal ones the first.
fn best(scored: impl Iterator<Item = (usize, f32)>, most: usize) -> Vec<(usize, f32)> {
    let mut scored: Vec<(usize, f32)> = scored.collect();
    scored.sort_by(|a, b| b.1.total_cmp(&a.1));
    scored.truncate(most);
    scored
}
