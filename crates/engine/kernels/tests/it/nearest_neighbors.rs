//! The search for nearest neighbors against all pairs of points.

use crate::threads;
use proptest::prelude::*;
use weaver_kernels::nearest_neighbors::nearest_neighbors;
use weaver_kernels::random::Stream;

/// Points that are spread, on a surface, on a coarse lattice (many in one place), or all in one place.
fn points(kind: usize, n: usize, seed: u64) -> Vec<f32> {
    let stream = Stream::new(seed, 0, "points");
    (0..3 * n as u64)
        .map(|i| match (kind, i % 3) {
            (0, _) => stream.normal(i),
            (1, 2) => 2.0 + 1e-3 * stream.normal::<f32>(i),
            (1, _) => stream.uniform(i),
            (2, _) => stream.below(i, 3) as f32,
            _ => 0.25,
        })
        .collect()
}

fn squared_distance(points: &[f32], i: usize, j: usize) -> f32 {
    let d = [0, 1, 2].map(|a| points[3 * j + a] - points[3 * i + a]);
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}

fn search(points: &[f32], k: usize) -> Vec<u32> {
    let mut neighbors = vec![u32::MAX; points.len() / 3 * (k + 1)];
    nearest_neighbors(points, k, &mut neighbors);
    neighbors
}

fn check(points: &[f32], k: usize) {
    let n = points.len() / 3;
    for (i, row) in search(points, k).chunks_exact(k + 1).enumerate() {
        assert_eq!(row[0] as usize, i, "the point itself is first");
        let others = k.min(n - 1);
        let (found, padding) = row[1..].split_at(others);
        assert!(padding.iter().all(|&p| p as usize == i));
        let mut distinct = found.to_vec();
        distinct.sort_unstable();
        distinct.dedup();
        assert!(distinct.len() == others && !found.contains(&(i as u32)), "{i}: {row:?}");
        let mut all: Vec<f32> = (0..n).filter(|&j| j != i).map(|j| squared_distance(points, i, j)).collect();
        all.sort_by(f32::total_cmp);
        let found: Vec<f32> = found.iter().map(|&j| squared_distance(points, i, j as usize)).collect();
        assert_eq!(found, all[..others], "point {i} of {n}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 10))]
    #[test]
    fn all_pairs_agree(kind in 0..4usize, n in 1..300usize, k in 0..12usize, seed in 0..1000u64) {
        check(&points(kind, n, seed), k);
    }
}

#[test]
fn no_points_and_broken_points() {
    assert!(search(&[], 8).is_empty());
    let mut broken = points(0, 100, 1);
    broken[30] = f32::NAN;
    let neighbors = search(&broken, 8);
    assert!(neighbors.iter().all(|&j| j < 100));
    let named = neighbors.chunks_exact(9).enumerate().filter(|(i, row)| *i != 10 && row.contains(&10));
    assert_eq!(named.count(), 0, "no point is a neighbor of NaN");
}

/// Many points in one place are quick and threads do not matter.
#[test]
fn many_points_in_one_place_are_quick() {
    let same = points(3, 20_000, 0);
    threads(|| search(&same, 8).iter().map(|&i| i as f32).collect());
}

#[test]
#[should_panic(expected = "expected k of at most 63, found 64")]
fn too_many_neighbors_are_refused() {
    search(&points(0, 100, 1), 64);
}
