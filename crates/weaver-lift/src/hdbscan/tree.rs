//! How points hang together: core distances, the tree that spans them, and its merges.

use weaver_kernels::parallel;

/// Points of a parallel task.
const GRAIN: usize = 512;

fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// The distance from each point to its `samples`-th nearest other, or to the farthest where there are not so many.
pub(super) fn core_distances(points: &[f64], dimensions: usize, samples: usize) -> Vec<f64> {
    let count = points.len() / dimensions;
    let mut core = vec![0.0; count];
    // The point itself is the nearest.
    let rank = samples.min(count - 1);
    parallel::for_chunks(&mut core, GRAIN / 16, |chunk, core| {
        let mut distances = vec![0.0; count];
        for (i, core) in core.iter_mut().enumerate() {
            let point = &points[(chunk * (GRAIN / 16) + i) * dimensions..][..dimensions];
            let others = points.chunks_exact(dimensions);
            distances.iter_mut().zip(others).for_each(|(d, other)| *d = squared_distance(point, other));
            *core = distances.select_nth_unstable_by(rank, f64::total_cmp).1.sqrt();
        }
    });
    core
}

/// An edge between two points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    ends: [usize; 2],
    length: f64,
}

/// How near the tree is to a point.
#[derive(Clone, Copy)]
struct Reach {
    distance: f64,
    joined: bool,
}

/// The smallest tree that spans all points by mutual reachability, `max(core a, core b, |a - b|)`: Prim's, from point 0.
///
/// Each edge is to the point that joined before, not to the one that was near: what hangs together up to any distance joins in one
/// go, so that the same parts merge.
pub(super) fn spanning_tree(points: &[f64], dimensions: usize, core: &[f64]) -> Vec<Edge> {
    let count = core.len();
    let mut reach = vec![Reach { distance: f64::INFINITY, joined: false }; count];
    let mut nearest = vec![(f64::INFINITY, 0); count.div_ceil(GRAIN)];
    let mut edges = Vec::with_capacity(count - 1);
    let mut last = 0;
    reach[0].joined = true;
    for _ in 1..count {
        let at = &points[last * dimensions..][..dimensions];
        parallel::for_chunks2(&mut reach, GRAIN, &mut nearest, 1, |chunk, reach, nearest| {
            let mut best = (f64::INFINITY, usize::MAX);
            for (i, reach) in reach.iter_mut().enumerate().filter(|(_, reach)| !reach.joined) {
                let n = chunk * GRAIN + i;
                let distance = squared_distance(at, &points[n * dimensions..][..dimensions]).sqrt();
                let distance = distance.max(core[n]).max(core[last]);
                reach.distance = reach.distance.min(distance);
                if reach.distance < best.0 || best.1 == usize::MAX {
                    best = (reach.distance, n);
                }
            }
            nearest[0] = best;
        });
        let open = nearest.iter().filter(|(_, n)| *n != usize::MAX);
        let Some(&(length, next)) = open.min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        edges.push(Edge { ends: [last, next], length });
        reach[next].joined = true;
        last = next;
    }
    edges
}

/// Two parts that become one. Parts below N are points, part N + i is what merge i made.
#[derive(Clone, Copy, Debug)]
pub(super) struct Merge {
    pub parts: [usize; 2],
    pub distance: f64,
    /// Points of the whole.
    pub size: usize,
}

/// The merges along a tree, shortest edges first.
pub(super) fn merges(mut edges: Vec<Edge>, count: usize) -> Vec<Merge> {
    edges.sort_by(|a, b| a.length.total_cmp(&b.length));
    let mut parents: Vec<usize> = (0..2 * count - 1).collect();
    let mut sizes = vec![1; 2 * count - 1];
    let mut merges = Vec::with_capacity(edges.len());
    for Edge { ends, length } in edges {
        let whole = count + merges.len();
        let parts = ends.map(|end| root(&mut parents, end));
        sizes[whole] = sizes[parts[0]] + sizes[parts[1]];
        parts.iter().for_each(|part| parents[*part] = whole);
        merges.push(Merge { parts, distance: length, size: sizes[whole] });
    }
    merges
}

/// The part that a part now belongs to; ways there are made short.
fn root(parents: &mut [usize], mut part: usize) -> usize {
    while parents[part] != part {
        parents[part] = parents[parents[part]];
        part = parents[part];
    }
    part
}
