//! Tracks of matches.

use proptest::prelude::*;
use weaver_sfm::{Match, tracks};

/// A number for each of 16 photos: of eight the remainder is the same, by which photos are compared first.
fn number(photo: usize) -> usize {
    photo / 2 * 64 + photo % 2
}

proptest! {
    /// For any matches, a track holds a photo once, every keypoint is in one track at most, and the order of pairs does
    /// not count.
    #[test]
    fn hold_a_photo_once(found in proptest::collection::vec((0..16usize, 0..16usize, 0..2u32, 0..2u32, 0.0..1.0f32), 0..120)) {
        let mut pairs: Vec<([usize; 2], Vec<Match>)> = (found.iter())
            .filter(|(a, b, ..)| a < b)
            .map(|(a, b, first, second, ratio)| {
                ([number(*a), number(*b)], vec![Match { first: *first, second: *second, ratio: *ratio }])
            })
            .collect();
        let found = tracks(&[2; 450], &pairs);
        let mut all: Vec<(usize, usize)> = found.concat();
        for track in &found {
            prop_assert!(track.len() > 1 && track.windows(2).all(|pair| pair[0].0 < pair[1].0));
        }
        let count = all.len();
        all.sort_unstable();
        all.dedup();
        prop_assert_eq!(all.len(), count);
        let mut sorted = found.clone();
        sorted.sort();
        prop_assert_eq!(&sorted, &joined_one_by_one(&[2; 450], &pairs));
        pairs.reverse();
        prop_assert_eq!(tracks(&[2; 450], &pairs), found);
    }
}

/// The slow twin: groups of keypoints, of which two are joined by a match, the clearest first, unless they have a photo
/// in common.
fn joined_one_by_one(counts: &[usize], pairs: &[([usize; 2], Vec<Match>)]) -> Vec<Vec<(usize, usize)>> {
    let all = counts.iter().enumerate().flat_map(|(photo, count)| (0..*count).map(move |keypoint| (photo, keypoint)));
    let mut groups: Vec<Vec<(usize, usize)>> = all.map(|keypoint| vec![keypoint]).collect();
    let mut links: Vec<(f32, [(usize, usize); 2])> = Vec::new();
    for ([a, b], matches) in pairs {
        links.extend(matches.iter().map(|m| (m.ratio, [(*a, m.first as usize), (*b, m.second as usize)])));
    }
    links.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
    for (_, ends) in links {
        let [a, b] = ends.map(|end| groups.iter().position(|group| group.contains(&end)).expect("a group of each"));
        let shared = groups[a].iter().any(|(photo, _)| groups[b].iter().any(|(other, _)| other == photo));
        if a != b && !shared {
            let (kept, gone) = (a.min(b), a.max(b));
            let others = groups.remove(gone);
            groups[kept].extend(others);
        }
    }
    groups.retain(|group| group.len() > 1);
    groups.iter_mut().for_each(|group| group.sort_unstable());
    groups.sort();
    groups
}
