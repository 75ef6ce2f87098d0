//! Tracks of matches.

use proptest::prelude::*;
use weaver_sfm::{Match, tracks};

proptest! {
    /// For any matches, a track holds a photo once, every keypoint is in one track at most, and the order of pairs does
    /// not count.
    #[test]
    fn hold_a_photo_once(found in proptest::collection::vec((0..4usize, 0..4usize, 0..6u32, 0..6u32, 0.0..1.0f32), 0..60)) {
        let mut pairs: Vec<([usize; 2], Vec<Match>)> = (found.iter())
            .filter(|(a, b, ..)| a < b)
            .map(|(a, b, first, second, ratio)| ([*a, *b], vec![Match { first: *first, second: *second, ratio: *ratio }]))
            .collect();
        let found = tracks(&[6; 4], &pairs);
        let mut all: Vec<(usize, usize)> = found.concat();
        for track in &found {
            prop_assert!(track.len() > 1 && track.windows(2).all(|pair| pair[0].0 < pair[1].0));
        }
        let count = all.len();
        all.sort_unstable();
        all.dedup();
        prop_assert_eq!(all.len(), count);
        pairs.reverse();
        prop_assert_eq!(tracks(&[6; 4], &pairs), found);
    }
}
