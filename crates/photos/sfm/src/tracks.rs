//! Tracks: keypoints of many photos that are the same point.

use crate::matching::Match;

/// Keypoints of one point: photo and index within it, at most one a photo, ascending by photo.
pub type Track = Vec<(usize, usize)>;

/// Joins matches of pairs of photos to tracks, the clearest first; a match that would join two keypoints of one photo
/// is left out. `counts` are the numbers of keypoints of the photos.
///
/// ```
/// use weaver_sfm::{Match, tracks};
/// let m = |first, second, ratio| Match { first, second, ratio };
/// let pairs = [([0, 1], vec![m(3, 4, 0.5)]), ([1, 2], vec![m(4, 0, 0.6)]), ([0, 2], vec![m(2, 0, 0.8)])];
/// assert_eq!(tracks(&[5, 5, 5], &pairs), [vec![(0, 3), (1, 4), (2, 0)]]);
/// ```
pub fn tracks(counts: &[usize], pairs: &[([usize; 2], Vec<Match>)]) -> Vec<Track> {
    joined(counts, pairs.iter().map(|(photos, matches)| (*photos, &matches[..])))
}

/// The same for borrowed matches.
pub(crate) fn joined<'a>(counts: &[usize], pairs: impl Iterator<Item = ([usize; 2], &'a [Match])>) -> Vec<Track> {
    let mut first = vec![0];
    counts.iter().for_each(|n| first.push(first[first.len() - 1] + n));
    let mut links: Vec<(f32, u32, u32)> = Vec::new();
    for ([a, b], matches) in pairs {
        let link = |m: &Match| (m.ratio, first[a] as u32 + m.first, first[b] as u32 + m.second);
        links.extend(matches.iter().map(link));
    }
    links.sort_unstable_by(|x, y| x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    let photos: Vec<u32> =
        (counts.iter().enumerate()).flat_map(|(photo, count)| std::iter::repeat_n(photo as u32, *count)).collect();
    let mut parent: Vec<u32> = (0..photos.len() as u32).collect();
    let mut next = parent.clone();
    // The photos of the keypoints joined with a root, modulo 64: without a common one, no photo is there twice.
    let mut some: Vec<u64> = photos.iter().map(|photo| 1 << (photo % 64)).collect();
    // The last link for which each photo was found in the first track.
    let mut found = vec![usize::MAX; counts.len()];
    for (number, (_, a, b)) in links.into_iter().enumerate() {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        if a == b {
            continue;
        }
        let photo = |keypoint: u32| photos[keypoint as usize] as usize;
        let both = [some[a as usize], some[b as usize]];
        let twice = both[0] & both[1] != 0 && {
            ring(&next, a).for_each(|keypoint| found[photo(keypoint)] = number);
            ring(&next, b).any(|keypoint| found[photo(keypoint)] == number)
        };
        if !twice {
            next.swap(a as usize, b as usize);
            parent[a.max(b) as usize] = a.min(b);
            some[a.min(b) as usize] = both[0] | both[1];
        }
    }
    let begins = |keypoint: &u32| parent[*keypoint as usize] == *keypoint && next[*keypoint as usize] != *keypoint;
    let track = |from: u32| {
        let seen = |keypoint: u32| {
            let photo = photos[keypoint as usize] as usize;
            (photo, keypoint as usize - first[photo])
        };
        let mut track: Track = ring(&next, from).map(seen).collect();
        track.sort_unstable();
        track
    };
    (0..photos.len() as u32).filter(begins).map(track).collect()
}

fn root(parent: &mut [u32], mut at: u32) -> u32 {
    while parent[at as usize] != at {
        parent[at as usize] = parent[parent[at as usize] as usize];
        at = parent[at as usize];
    }
    at
}

/// The keypoints that are joined with one, each followed by its next, which lead back to it.
fn ring(next: &[u32], from: u32) -> impl Iterator<Item = u32> {
    std::iter::successors(Some(from), move |at| Some(next[*at as usize]).filter(|at| *at != from))
}
