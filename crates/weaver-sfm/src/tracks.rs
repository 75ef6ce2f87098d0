//! Tracks: keypoints of many photos that are the same point.

use crate::matching::Match;

/// Keypoints of one point: photo and number there, at most one a photo, ascending by photo.
pub type Track = Vec<(usize, usize)>;

/// Joins matches of pairs of photos to tracks, the clearest first; a match that would join two keypoints of one photo is
/// left out. `counts` are the numbers of keypoints of the photos.
///
/// ```
/// use weaver_sfm::{Match, tracks};
/// let m = |first, second, ratio| Match { first, second, ratio };
/// let pairs = [([0, 1], vec![m(3, 4, 0.5)]), ([1, 2], vec![m(4, 0, 0.6)]), ([0, 2], vec![m(2, 0, 0.8)])];
/// assert_eq!(tracks(&[5, 5, 5], &pairs), [vec![(0, 3), (1, 4), (2, 0)]]);
/// ```
pub fn tracks(counts: &[usize], pairs: &[([usize; 2], Vec<Match>)]) -> Vec<Track> {
    let mut first = vec![0];
    counts.iter().for_each(|n| first.push(first[first.len() - 1] + n));
    let mut links: Vec<(f32, usize, usize)> = Vec::new();
    for ([a, b], matches) in pairs {
        links.extend(matches.iter().map(|m| (m.ratio, first[*a] + m.first, first[*b] + m.second)));
    }
    links.sort_by(|x, y| x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    let mut parent: Vec<usize> = (0..first[counts.len()]).collect();
    let mut tracks: Vec<Track> = (counts.iter().enumerate())
        .flat_map(|(photo, count)| (0..*count).map(move |keypoint| vec![(photo, keypoint)]))
        .collect();
    for (_, a, b) in links {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        let (a, b) = (a.min(b), a.max(b));
        let twice = || tracks[b].iter().any(|(photo, _)| tracks[a].iter().any(|(other, _)| other == photo));
        if a != b && !twice() {
            let joined = std::mem::take(&mut tracks[b]);
            tracks[a].extend(joined);
            parent[b] = a;
        }
    }
    tracks.retain(|track| track.len() > 1);
    tracks.iter_mut().for_each(|track| track.sort_unstable());
    tracks
}

fn root(parent: &mut [usize], mut at: usize) -> usize {
    while parent[at] != at {
        parent[at] = parent[parent[at]];
        at = parent[at];
    }
    at
}
