//! Ties between the photos of a scene, and contradictions of them.

use crate::pairs::Pair;

/// The share of the matches of a pair that must agree with its own pose for it not to be chance.
const TIED: f64 = 0.35;
/// Shares of a pair's matches that agree with the cameras of a scene: from the first on the pair holds its photos
/// together, below the second it contradicts them.
const HOLDS: f64 = 0.7;
const CONTRADICTS: f64 = 0.5;
/// The place of a part is doubtful if the matches that contradict it are more than this part of the ones that hold it.
/// Of the captures that it was chosen on, right scenes come to 0.45 and most wrong ones to 0.6 and more.
const DOUBTFUL: f64 = 0.5;

/// Two photos of a scene, and the numbers of matches that hold them together and that contradict it.
#[derive(Clone, Copy, Debug)]
struct Tie {
    photos: [usize; 2],
    holds: f64,
    contradicts: f64,
}

/// A part of a scene, at most half of it, and the doubt about its place: matches that contradict it over matches that
/// hold it.
type Part = (Vec<usize>, f64);

/// The photos without any tie to most of the others; if there are none, the photos of the part with the most doubtful
/// place; empty where no place is doubtful.
///
/// Where things repeat, photos of different ones match, and a part of a scene that is consistent in itself can stand in
/// a wrong place. Pairs with the rest that show the same thing then contradict it. Parts are single photos, and the
/// photos joined to them by ties, the strongest first. Photos of a rig count as the first of them, which `first_of`
/// names. `agreeing` counts the matches of a pair that agree with the
/// cameras of the scene.
pub(crate) fn untied(
    pairs: &[Pair],
    placed: &[bool],
    first_of: impl Fn(usize) -> usize,
    agreeing: impl Fn(&Pair) -> usize,
) -> Vec<usize> {
    let tie = |pair: &Pair| {
        let (agree, all) = (agreeing(pair) as f64, pair.matches.len() as f64);
        Tie {
            photos: pair.photos.map(&first_of),
            holds: if agree >= HOLDS * all { agree } else { 0.0 },
            contradicts: if agree < CONTRADICTS * all { all - agree } else { 0.0 },
        }
    };
    let of_placed = |pair: &&Pair| pair.certain(TIED) && pair.photos.iter().all(|photo| placed[*photo]);
    let mut ties: Vec<Tie> = pairs.iter().filter(of_placed).map(tie).collect();
    ties.sort_by(|a, b| b.holds.total_cmp(&a.holds));
    let photos: Vec<usize> = (0..placed.len()).filter(|photo| placed[*photo] && first_of(*photo) == *photo).collect();
    let mut part: Vec<usize> = (0..placed.len()).collect();
    let mut parts: Vec<Part> = photos.iter().map(|photo| smaller(&ties, &photos, &part, *photo)).collect();
    for tie in ties.iter().filter(|tie| tie.holds > 0.0) {
        let [a, b] = tie.photos.map(|photo| part[photo]);
        if a != b {
            part.iter_mut().filter(|part| **part == b).for_each(|part| *part = a);
            parts.push(smaller(&ties, &photos, &part, a));
        }
    }
    let size = |of: usize| photos.iter().filter(|photo| part[**photo] == of).count();
    // The first of the largest.
    let largest = photos.iter().map(|photo| part[*photo]).rev().max_by_key(|of| size(*of));
    let apart: Vec<usize> = photos.iter().copied().filter(|photo| Some(part[*photo]) != largest).collect();
    if !apart.is_empty() {
        return apart;
    }
    let doubtful = parts.into_iter().filter(|(_, doubt)| *doubt > DOUBTFUL);
    doubtful.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(Vec::new(), |(part, _)| part)
}

/// A part or the rest, whichever is smaller, and the doubt about its place.
fn smaller(ties: &[Tie], photos: &[usize], part: &[usize], of: usize) -> Part {
    let across = ties.iter().filter(|tie| (part[tie.photos[0]] == of) != (part[tie.photos[1]] == of));
    let [holds, contradicts] = across.fold([0.0; 2], |[h, c], tie| [h + tie.holds, c + tie.contradicts]);
    let (inside, outside): (Vec<usize>, Vec<usize>) = photos.iter().partition(|photo| part[**photo] == of);
    // The whole has nothing across, so that there is no doubt.
    (if inside.len() <= outside.len() { inside } else { outside }, if holds > 0.0 { contradicts / holds } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matching::Match;
    use weaver_geometry::Pose;

    /// A pair with so many matches, and this share of them agreeing with its own pose.
    fn pair(photos: [usize; 2], count: usize, share: f64) -> Pair {
        Pair {
            photos,
            pose: Pose::IDENTITY,
            rival: None,
            inverse_depths: vec![1.0; count],
            parallax: 0.1,
            score: 1.0,
            turned: 0.0,
            share,
            matches: (0..count as u32).map(|i| Match { first: i, second: i, ratio: 0.5 }).collect(),
        }
    }

    /// Photos that only chance ties to the others are named.
    ///
    /// Promise (figures): photos that nothing ties to the others are named, and a part of a scene whose place matches
    /// contradict.
    #[test]
    fn photos_tied_by_chance_are_named() {
        let pairs = [
            pair([0, 1], 100, 0.9),
            pair([1, 2], 100, 0.9),
            pair([3, 4], 100, 0.9),
            pair([2, 3], 19, 0.9),
            pair([1, 4], 100, 0.9 * TIED),
            pair([2, 5], 100, 0.9),
            pair([4, 5], 100, 0.9),
        ];
        let named = |placed: [bool; 6]| untied(&pairs, &placed, |photo| photo, |pair| pair.matches.len());
        assert_eq!(named([true, true, true, true, true, false]), [3, 4], "5 has no place and ties nothing");
        assert_eq!(named([true; 6]), [0; 0]);
        assert_eq!(named([false, false, true, true, false, false]), [3], "of two the second");
        assert_eq!(named([true, false, true, false, true, false]), [2, 4], "of three that nothing ties");
        assert_eq!(named([false; 6]), [0; 0]);
    }

    /// A photo is named if the matches that contradict its place are more than half as many as the ones that hold it.
    ///
    /// Promise of `photos_tied_by_chance_are_named`.
    #[test]
    fn photos_whose_place_is_contradicted_are_named() {
        let pairs = [
            pair([0, 1], 200, 0.9),
            pair([1, 2], 150, 0.9),
            pair([2, 3], 80, 0.9),
            pair([3, 4], 100, 0.9),
            pair([0, 4], 60, 0.9),
        ];
        // The part of the matches of the last pair that agrees.
        let named = |agrees: f64| {
            untied(
                &pairs,
                &[true; 5],
                |photo| photo,
                |pair| match pair.photos {
                    [0, 4] => (agrees * 60.0) as usize,
                    _ => pair.matches.len(),
                },
            )
        };
        assert_eq!(named(1.0), [0; 0]);
        assert_eq!(named(0.6), [0; 0], "neither holds nor contradicts");
        assert_eq!(named(0.4), [0; 0], "36 of 80");
        assert_eq!(named(0.2), [3, 4], "48 of 80");
    }
}
