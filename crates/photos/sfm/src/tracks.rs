//! Tracks: keypoints of many photos that are the same point.

use crate::matching::Match;
use std::collections::HashMap;

/// Keypoints of a track up to which its photos are compared one by one.
const FEW: u32 = 8;

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
    let mut joined = Joined::new(photos, counts.len());
    for (_, a, b) in links {
        joined.join(a, b);
    }
    let Joined { photos, parent, next, .. } = joined;
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

/// Keypoints that are joined so far: a forest, and a ring through each tree.
struct Joined {
    /// The photo of each keypoint.
    photos: Vec<u32>,
    parent: Vec<u32>,
    next: Vec<u32>,
    /// Number of keypoints of a root.
    size: Vec<u32>,
    /// The photos of a root, modulo 64: without a common one, no photo is there twice.
    some: Vec<u64>,
    /// The photos of a root of more than [`FEW`] keypoints, as bits: most links lead from one such root to another that
    /// they must not be joined with, and each would walk both rings.
    all: HashMap<u32, Box<[u64]>>,
    /// Words of the bits of all photos.
    words: usize,
}

impl Joined {
    fn new(photos: Vec<u32>, count: usize) -> Self {
        let parent: Vec<u32> = (0..photos.len() as u32).collect();
        Self {
            next: parent.clone(),
            parent,
            size: vec![1; photos.len()],
            some: photos.iter().map(|photo| 1 << (photo % 64)).collect(),
            all: HashMap::new(),
            words: count.div_ceil(64),
            photos,
        }
    }

    /// Joins the keypoints of `a` with those of `b`, unless two of them are in one photo.
    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (root(&mut self.parent, a), root(&mut self.parent, b));
        if a == b || self.meet(a, b) {
            return;
        }
        let (root, other) = (a.min(b), a.max(b));
        let [large, small] = if self.size[a as usize] < self.size[b as usize] { [b, a] } else { [a, b] };
        let mut all = self.all.remove(&large);
        if all.is_none() && self.size[a as usize] + self.size[b as usize] > FEW {
            let mut bits = vec![0; self.words].into_boxed_slice();
            ring(&self.next, large).for_each(|keypoint| set(&mut bits, self.photos[keypoint as usize]));
            all = Some(bits);
        }
        if let Some(mut all) = all {
            ring(&self.next, small).for_each(|keypoint| set(&mut all, self.photos[keypoint as usize]));
            self.all.remove(&small);
            self.all.insert(root, all);
        }
        self.next.swap(a as usize, b as usize);
        self.parent[other as usize] = root;
        self.size[root as usize] += self.size[other as usize];
        self.some[root as usize] |= self.some[other as usize];
    }

    /// True if two roots have keypoints in one photo.
    fn meet(&self, a: u32, b: u32) -> bool {
        if self.some[a as usize] & self.some[b as usize] == 0 {
            return false;
        }
        let photos = |from: u32| ring(&self.next, from).map(|keypoint| self.photos[keypoint as usize]);
        let within =
            |all: &[u64], from: u32| photos(from).any(|photo| all[photo as usize / 64] >> (photo % 64) & 1 == 1);
        match (self.all.get(&a), self.all.get(&b)) {
            (Some(a), Some(b)) => a.iter().zip(b).any(|(a, b)| a & b != 0),
            (Some(all), None) => within(all, b),
            (None, Some(all)) => within(all, a),
            (None, None) => photos(a).any(|photo| photos(b).any(|other| other == photo)),
        }
    }
}

/// Sets the bit of a photo.
fn set(bits: &mut [u64], photo: u32) {
    bits[photo as usize / 64] |= 1 << (photo % 64);
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
