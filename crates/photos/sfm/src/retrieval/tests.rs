use super::*;
use crate::descriptor::DESCRIPTOR;
use crate::features::Keypoint;
use weaver_geometry::glam::DVec2;
use weaver_kernels::random::Stream;

/// Length of a descriptor.
const LENGTH: f32 = 250.0;

/// Landmarks that a photo sees, and how many of them the next one sees no more.
const SEEN: usize = 120;
const STEP: usize = 15;

/// Photos along a path that is closed after `around` of them: each sees the landmarks beside it, and as many things of
/// its own.
fn walk(photos: usize, around: usize) -> Vec<Features> {
    (0..photos)
        .map(|photo| {
            let first = photo % around * STEP;
            let landmark = |i: usize| 1 + ((first + i) % (around * STEP)) as u64;
            let own = Stream::new(1, photo as u64, "test.own");
            let mut features = Features::default();
            for i in 0..2 * SEEN {
                let of =
                    if i < SEEN { Stream::new(1, 0, "test.landmarks").fork(landmark(i)) } else { own.fork(i as u64) };
                let noise = own.fork((i + 2 * SEEN) as u64);
                let value = |j: u64| of.uniform::<f32>(j).powi(4) + 0.1 * noise.uniform::<f32>(j);
                let values: Vec<f32> = (0..DESCRIPTOR as u64).map(value).collect();
                let length = values.iter().map(|x| x * x).sum::<f32>().sqrt();
                features.descriptors.extend(values.iter().map(|x| (LENGTH * x / length).round() as u8));
                let scale = 2.0 + (i % 7) as f64;
                features.keypoints.push(Keypoint { pixel: DVec2::ZERO, scale, angle: 0.0, contrast: 1.0 });
            }
            features
        })
        .collect()
}

fn threads<R: Send>(n: usize, body: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("a pool").install(body)
}

/// Photos of the same landmarks are found also where the path comes back.
#[test]
fn loops_are_retrieved() {
    let (photos, around) = (60, 45);
    let features = walk(photos, around);
    let pairs = candidates(&features, &[true; 60], 6, false);
    let apart = |[a, b]: [usize; 2]| {
        let by = (b - a) % around;
        by.min(around - by)
    };
    let near = pairs.iter().filter(|pair| apart(**pair) <= 4).count();
    assert!(near * 20 >= pairs.len() * 19, "{near} of {}", pairs.len());
    assert!(pairs.is_sorted_by(|a, b| a < b) && pairs.iter().all(|[a, b]| a < b));
    // Fifteen photos stand where others did, and neighbors across the place where the path closes see the same.
    for again in around..photos {
        assert!(pairs.contains(&[again - around, again]), "{again}");
    }
    assert!(pairs.len() <= 6 * photos && pairs.len() >= 3 * photos);
}

/// Photos that are not present change nothing for the others.
#[test]
fn absent_photos_change_nothing() {
    let features = walk(40, 40);
    let present: Vec<bool> = (0..40).map(|i| i % 4 != 2).collect();
    let inside: Vec<usize> = (0..40).filter(|i| present[*i]).collect();
    let alone: Vec<Features> = inside.iter().map(|i| features[*i].clone()).collect();
    for (most, sequence) in [(5, false), (12, true), (100, false)] {
        let pairs = candidates(&features, &present, most, sequence);
        let without = candidates(&alone, &vec![true; alone.len()], most, sequence);
        let among: Vec<[usize; 2]> = pairs.iter().copied().filter(|pair| pair.iter().all(|i| present[*i])).collect();
        assert_eq!(among, without.iter().map(|pair| pair.map(|i| inside[i])).collect::<Vec<_>>());
        for query in (0..40).filter(|i| !present[*i]) {
            let with: Vec<usize> = (pairs.iter().filter(|pair| pair.contains(&query)))
                .map(|[a, b]| if *a == query { *b } else { *a })
                .collect();
            assert_eq!(with.len(), most.min(alone.len()), "query {query}");
            assert!(with.iter().all(|other| present[*other]));
            assert!(with.contains(&(query - 1)) && with.contains(&((query + 1) % 40)));
        }
    }
}

#[test]
fn the_same_pairs_at_any_number_of_threads() {
    let features = walk(50, 50);
    let of = |n| threads(n, || candidates(&features, &[true; 50], 8, false));
    assert_eq!(of(1), of(3));
}

/// In a sequence neighbors are compared regardless of their similarity.
#[test]
fn neighbors_of_a_sequence_are_compared() {
    let mut features = walk(50, 40);
    features[20] = Features::default();
    let pairs = candidates(&features, &[true; 50], 10, true);
    for other in [12, 16, 18, 19, 21, 22, 24, 28] {
        assert!(pairs.contains(&[other.min(20), other.max(20)]), "{other}");
    }
    assert!(!pairs.contains(&[3, 6]) && pairs.contains(&[3, 43]));
}

#[test]
fn few_photos_are_all_compared_and_none_are_no_pairs() {
    let features = walk(5, 5);
    assert_eq!(candidates(&features, &[true; 5], 4, false).len(), 10);
    assert_eq!(candidates(&features, &[true, true, true, false, false], 4, false).len(), 3 + 6);
    assert_eq!(candidates(&[], &[], 4, true), Vec::<[usize; 2]>::new());
    let blank = vec![Features::default(); 9];
    assert!(candidates(&blank, &[true; 9], 3, false).len() < 9 * 4);
    assert_eq!(candidates(&blank, &[false; 9], 3, false), Vec::<[usize; 2]>::new());
}

#[test]
fn friends_of_friends_come_next() {
    let verified = [([0, 1], 50), ([1, 2], 40), ([2, 3], 90), ([0, 4], 30), ([4, 2], 20), ([1, 5], 45)];
    let tried: Vec<[usize; 2]> = verified.iter().map(|(pair, _)| *pair).chain([[5, 0]]).collect();
    let all = expansion(&[true; 6], &verified, &tried, 9);
    assert_eq!(all, [[0, 2], [1, 3], [1, 4], [2, 5], [3, 4]]);
    // 0 to 2 by two ways, 40 and 20.
    assert_eq!(expansion(&[true; 6], &verified, &tried, 1), [[0, 2], [1, 3], [1, 4], [2, 5]]);
    // Without 1, nothing leads over it; it is still given to those that are there.
    let present = [true, false, true, true, true, true];
    assert_eq!(expansion(&present, &verified, &tried, 9), [[0, 2], [1, 3], [1, 4], [3, 4]]);
}
