//! The k nearest neighbors of every point of a set, in three dimensions.

mod kd_tree;

use crate::Real;
use crate::parallel::for_chunks;
use kd_tree::KdTree;

/// Points of one parallel task.
const GRAIN: usize = 256;

/// The largest k that [`nearest_neighbors`] accepts.
pub const MAX_NEIGHBORS: usize = 63;

/// Finds the `k` nearest neighbors of every one of `points` `[N, 3]` among the others, by Euclidean distance.
///
/// Row i of `neighbors` `[N, 1 + k]` becomes i itself followed by its neighbors, nearest first. Where fewer than k
/// other points exist, i fills the rest of the row. The search is exact up to the rounding of squared distances; among
/// points at the same distance, which ones are taken depends on the points alone, not on the number of threads. A point
/// with a NaN coordinate is no other point's neighbor.
///
/// Builds a k-d tree in O(N log N) and searches it in parallel. The tree is the only memory allocated.
///
/// # Panics
///
/// If `k` is above [`MAX_NEIGHBORS`], or a length does not fit.
///
/// ```
/// use weaver_kernels::nearest_neighbors::nearest_neighbors;
/// let points = [0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 4.0, 0.0, 0.0];
/// let mut neighbors = [0; 6];
/// nearest_neighbors(&points, 1, &mut neighbors);
/// assert_eq!(neighbors, [0, 1, 1, 2, 2, 1]);
/// ```
#[inline(never)]
pub fn nearest_neighbors<T: Real>(points: &[T], k: usize, neighbors: &mut [u32]) {
    assert!(k <= MAX_NEIGHBORS, "nearest_neighbors: expected k of at most {MAX_NEIGHBORS}, found {k}");
    let per_point = k + 1;
    assert_eq!(points.len() % 3, 0, "nearest_neighbors: points are not [N, 3]");
    assert_eq!(neighbors.len(), points.len() / 3 * per_point, "nearest_neighbors: neighbors are not [N, 1 + k]");
    let tree = KdTree::new(points);
    for_chunks(neighbors, GRAIN * per_point, |chunk, rows| {
        let mut distance = [T::ZERO; MAX_NEIGHBORS];
        for (row, nearest) in rows.chunks_exact_mut(per_point).enumerate() {
            let i = chunk * GRAIN + row;
            let query = [points[3 * i], points[3 * i + 1], points[3 * i + 2]];
            nearest[0] = i as u32;
            let found = tree.nearest(query, i as u32, &mut nearest[1..], &mut distance[..k]);
            nearest[1 + found..].fill(i as u32);
        }
    });
}

/// Writes the squared distance of each of `queries` `[M, 3]` to the nearest of `points` `[N, 3]`; infinite without
/// points.
///
/// # Panics
///
/// If a length does not fit.
///
/// ```
/// use weaver_kernels::nearest_neighbors::nearest_among;
/// let mut squares = [0.0; 2];
/// nearest_among(&[0.0, 0.0, 0.0, 3.0, 0.0, 0.0], &[1.0, 0.0, 0.0, 5.0, 0.0, 0.0], &mut squares);
/// assert_eq!(squares, [1.0, 4.0]);
/// ```
#[inline(never)]
pub fn nearest_among<T: Real>(points: &[T], queries: &[T], squares: &mut [T]) {
    assert_eq!(points.len() % 3, 0, "nearest_among: points are not [N, 3]");
    assert_eq!(queries.len(), 3 * squares.len(), "nearest_among: one distance for each query");
    let tree = KdTree::new(points);
    for_chunks(squares, GRAIN, |chunk, squares| {
        for (row, square) in squares.iter_mut().enumerate() {
            let i = chunk * GRAIN + row;
            let query = [queries[3 * i], queries[3 * i + 1], queries[3 * i + 2]];
            let (mut index, mut distance) = ([0], [T::from_f64(f64::INFINITY)]);
            if tree.nearest(query, u32::MAX, &mut index, &mut distance) > 0 {
                *square = distance[0];
            } else {
                *square = T::from_f64(f64::INFINITY);
            }
        }
    });
}
