//! Sorting primitives by group and depth: parallel, stable radix sorts on the group and on the upper half of the keys.

use super::coverage::UNSEEN;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use weaver_kernels::parallel;
use weaver_scene::Groups;

/// Shift and number of bits of each pass, over the 32 bits of depth.
const PASSES: [(u32, u32); 3] = [(32, 11), (43, 11), (54, 10)];
const DIGITS: usize = 1 << 11;
/// Fewer keys than this are sorted by comparison.
const FEW: usize = 2048;

/// Moves the keys below [`UNSEEN`] to the front of `sorted`, ascending; returns how many there are. `keys` are lost.
///
/// The lower half of a key is its index in `keys`, so that the order that stays among equal depths is ascending too.
pub(crate) fn sort(keys: &mut [AtomicU64], sorted: &mut [AtomicU64], counts: &mut Vec<u32>) -> usize {
    if keys.len() < FEW {
        let mut seen = 0;
        for key in keys.iter().map(|key| key.load(Relaxed)).filter(|&key| key != UNSEEN) {
            *sorted[seen].get_mut() = key;
            seen += 1;
        }
        sorted[..seen].sort_unstable_by_key(|key| key.load(Relaxed));
        return seen;
    }
    let (mut from, mut to) = (keys, sorted);
    let mut len = from.len();
    for (shift, bits) in PASSES {
        let digit = |key: u64| (key >> shift & ((1 << bits) - 1)) as usize;
        len = pass(&from[..len], to, (DIGITS, digit), counts);
        std::mem::swap(&mut from, &mut to);
    }
    len
}

/// Moves the keys below [`UNSEEN`] to the front of `to`, group by group, in each in their order; `ends` are where the
/// groups end.
///
/// Groups are sorted and binned one by one: the working set in the caches is then no larger than if each were drawn
/// alone.
pub(crate) fn split(
    from: &[AtomicU64],
    to: &[AtomicU64],
    groups: Groups<'_>,
    counts: &mut Vec<u32>,
    ends: &mut Vec<u32>,
) {
    let Groups { of, count } = groups;
    pass(from, to, (count, |key| of[key as u32 as usize] as usize), counts);
    ends.clear();
    // Each chunk leaves where it put the last key of a group; the last chunk, where the group ends.
    ends.extend_from_slice(&counts[counts.len() - count..]);
}

/// One stable pass by one of `digits` digits; returns how many keys were not [`UNSEEN`].
fn pass(
    from: &[AtomicU64],
    to: &[AtomicU64],
    (digits, digit): (usize, impl Fn(u64) -> usize + Sync),
    counts: &mut Vec<u32>,
) -> usize {
    // Enough chunks for many threads, few enough for the counts to stay in the cache. The result does not depend on
    // them.
    let chunks = (from.len() / (8 * DIGITS)).clamp(1, 32);
    let chunk_len = from.len().div_ceil(chunks);
    let part = |chunk: usize| -> Range<usize> { chunk * chunk_len..((chunk + 1) * chunk_len).min(from.len()) };
    let keys = |chunk: usize| from[part(chunk)].iter().map(|key| key.load(Relaxed)).filter(|&key| key != UNSEEN);
    counts.clear();
    counts.resize(chunks * digits, 0);
    parallel::for_chunks(counts, digits, |chunk, counts| {
        keys(chunk).for_each(|key| counts[digit(key)] += 1);
    });
    let mut next = 0;
    for digit in 0..digits {
        for chunk in 0..chunks {
            let count = &mut counts[chunk * digits + digit];
            next += std::mem::replace(count, next);
        }
    }
    parallel::for_chunks(counts, digits, |chunk, places| {
        keys(chunk).for_each(|key| {
            let place = &mut places[digit(key)];
            to[*place as usize].store(key, Relaxed);
            *place += 1;
        });
    });
    next as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_kernels::random::Stream;

    #[test]
    fn groups_in_their_order() {
        let groups = Groups { of: &[2, 0, 3, 0, 2, 0], count: 4 };
        let depths = [50, 41, 0, 13, 4, 25];
        let key = |i: usize| if depths[i] == 0 { UNSEEN } else { depths[i] << 32 | i as u64 };
        let keys: Vec<AtomicU64> = (0..6).map(|i| AtomicU64::new(key(i))).collect();
        let to: Vec<AtomicU64> = (0..6).map(|_| AtomicU64::new(0)).collect();
        let mut ends = Vec::new();
        split(&keys, &to, groups, &mut Vec::new(), &mut ends);
        assert_eq!(ends, [3, 3, 5, 5]);
        let depths: Vec<u64> = to[..5].iter().map(|key| key.load(Relaxed) >> 32).collect();
        assert_eq!(depths, [41, 13, 25, 50, 4]);
    }

    #[test]
    fn ascending_and_stable() {
        for (len, kinds) in [(0, 1), (5, 2), (3000, 7), (40_000, 1 << 20)] {
            let stream = Stream::new(len, 0, "sort");
            let key = |i: u64| match stream.below(i, kinds) {
                0 => UNSEEN,
                depth => (depth as u64) << 32 | i,
            };
            let mut keys: Vec<AtomicU64> = (0..len).map(|i| AtomicU64::new(key(i))).collect();
            let mut sorted: Vec<AtomicU64> = (0..len).map(|_| AtomicU64::new(0)).collect();
            let seen = sort(&mut keys, &mut sorted, &mut Vec::new());
            let mut expected: Vec<u64> = (0..len).map(key).filter(|&key| key != UNSEEN).collect();
            expected.sort();
            let sorted: Vec<u64> = sorted[..seen].iter().map(|key| key.load(Relaxed)).collect();
            assert_eq!(sorted, expected);
        }
    }
}
