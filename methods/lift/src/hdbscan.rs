//! Clusters of points by density, as many as there are.

mod condensed;
mod tree;

use condensed::condensed;
use tree::{Points, core_distances, merges, spanning_tree};

/// Definition of a cluster.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HdbscanOptions {
    /// Fewest points of a cluster, at least 2.
    pub smallest: usize,
    /// Number of neighbors in the estimate of the density around a point.
    pub samples: usize,
    /// Lower bound of distances, so that clusters do not fall apart by rounding; 0 for none.
    pub resolution: f64,
}

impl Default for HdbscanOptions {
    /// As published for lifted features.
    fn default() -> Self {
        Self { smallest: 500, samples: 10, resolution: 0.0 }
    }
}

/// The clusters of `points` `[N, dimensions]` by HDBSCAN with Euclidean distances: a number from 0 for each point, in
/// the order of the clusters' first points, or `None` for noise.
///
/// A point's core distance is the distance to its `samples`-th neighbor. Points are joined by the minimum spanning tree
/// of the largest of both core distances and their own distance. Among the clusters that it falls into, the selection
/// has the most excess of mass and never holds all points as one cluster. Takes time of N^2, and memory of N. Same bits
/// at any number of threads.
/// # Source
/// Campello, Moulavi, Zimek and Sander, 2015; McInnes, Healy and Astels, 2017.
///
/// ```
/// use weaver_lift::{HdbscanOptions, hdbscan};
/// let points = [0.0, 0.1, 0.2, 5.0, 5.1, 5.2, 50.0];
/// let labels = hdbscan(&points, 1, &HdbscanOptions { smallest: 3, samples: 1, resolution: 0.0 });
/// assert_eq!(labels, [Some(0), Some(0), Some(0), Some(1), Some(1), Some(1), None]);
/// ```
pub fn hdbscan(points: &[f64], dimensions: usize, options: &HdbscanOptions) -> Vec<Option<u32>> {
    let count = points.len() / dimensions.max(1);
    if count < 2 {
        return vec![None; count];
    }
    let points = Points::of(points, dimensions);
    let mut core = core_distances(&points, options.samples);
    // Neighbors are never nearer than a core distance.
    core.iter_mut().for_each(|core| *core = core.max(options.resolution));
    let edges = spanning_tree(&points, &core);
    let merges = merges(edges, count);
    let clusters = condensed(&merges, count, options.smallest.max(2));
    let chosen = clusters.chosen();
    let mut numbers = vec![None; chosen.len()];
    let mut next = 0;
    let mut number = |cluster: usize| {
        *numbers[cluster].get_or_insert_with(|| {
            next += 1;
            next - 1
        })
    };
    let of_point = |cluster: &usize| clusters.ancestors(*cluster).find(|at| chosen[*at]).map(&mut number);
    clusters.of_points.iter().map(of_point).collect()
}
