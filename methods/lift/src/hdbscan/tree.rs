//! Connectivity of points: core distances, the spanning tree, and its merges.

use weaver_kernels::parallel;

/// Points of a block, and of a parallel task.
const BLOCK: usize = 512;

/// Points in blocks, each coordinate by coordinate, so that distances to all points of a block are computed together.
pub(super) struct Points {
    /// `[blocks, dimensions, BLOCK]`, zeros beyond the last point.
    blocks: Vec<f64>,
    dimensions: usize,
    count: usize,
}

impl Points {
    /// Blocks of `rows` `[N, dimensions]`.
    pub fn of(rows: &[f64], dimensions: usize) -> Self {
        let count = rows.len() / dimensions.max(1);
        let mut blocks = vec![0.0; count.div_ceil(BLOCK) * dimensions * BLOCK];
        for (n, row) in rows.chunks_exact(dimensions.max(1)).enumerate() {
            let first = n / BLOCK * dimensions * BLOCK + n % BLOCK;
            row.iter().enumerate().for_each(|(d, x)| blocks[first + d * BLOCK] = *x);
        }
        Self { blocks, dimensions, count }
    }

    /// Coordinates of a point.
    fn point(&self, n: usize) -> Vec<f64> {
        let first = n / BLOCK * self.dimensions * BLOCK + n % BLOCK;
        (0..self.dimensions).map(|d| self.blocks[first + d * BLOCK]).collect()
    }

    /// Squared distances from `at` to the points of a block.
    fn squared_distances(&self, block: usize, at: &[f64]) -> [f64; BLOCK] {
        let mut sums = [0.0; BLOCK];
        let block = &self.blocks[block * self.dimensions * BLOCK..][..self.dimensions * BLOCK];
        for (xs, at) in block.as_chunks::<BLOCK>().0.iter().zip(at) {
            sums.iter_mut().zip(xs).for_each(|(sum, x)| *sum += (x - at) * (x - at));
        }
        sums
    }
}

/// The distance from each point to its `samples`-th nearest other, or to the farthest if there are fewer.
pub(super) fn core_distances(points: &Points, samples: usize) -> Vec<f64> {
    let mut core = vec![0.0; points.count];
    // The point itself is the nearest.
    let rank = samples.min(points.count - 1);
    parallel::for_chunks(&mut core, BLOCK / 16, |chunk, core| {
        let mut nearest = Vec::with_capacity(rank + 2);
        for (i, core) in core.iter_mut().enumerate() {
            let at = points.point(chunk * (BLOCK / 16) + i);
            nearest.clear();
            nearest.resize(rank + 1, f64::INFINITY);
            for block in 0..points.count.div_ceil(BLOCK) {
                let distances = points.squared_distances(block, &at);
                for &distance in &distances[..BLOCK.min(points.count - block * BLOCK)] {
                    if distance < nearest[rank] {
                        nearest.insert(nearest.partition_point(|other| *other <= distance), distance);
                        nearest.pop();
                    }
                }
            }
            *core = nearest[rank].sqrt();
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

/// Distance from the tree to one of its own points, as a marker.
const JOINED: f64 = -1.0;

/// The minimum spanning tree by mutual reachability, `max(core a, core b, |a - b|)`: Prim's, from point 0.
///
/// Each edge starts at the point that joined last, not at the nearest one: a part connected up to any distance joins in
/// one run, so that the same parts merge.
pub(super) fn spanning_tree(points: &Points, core: &[f64]) -> Vec<Edge> {
    let count = points.count;
    let mut reach = vec![f64::MAX; count];
    let mut nearest = vec![(f64::INFINITY, 0); count.div_ceil(BLOCK)];
    let mut edges = Vec::with_capacity(count - 1);
    let mut last = 0;
    reach[0] = JOINED;
    for _ in 1..count {
        let at = points.point(last);
        parallel::for_chunks2(&mut reach, BLOCK, &mut nearest, 1, |block, reach, nearest| {
            let distances = points.squared_distances(block, &at);
            let mut least = f64::INFINITY;
            for ((reach, distance), core_of) in reach.iter_mut().zip(distances).zip(&core[block * BLOCK..]) {
                *reach = reach.min(distance.sqrt().max(*core_of).max(core[last]));
                least = least.min(if *reach < 0.0 { f64::INFINITY } else { *reach });
            }
            let first = reach.iter().position(|reach| *reach == least).unwrap_or(0);
            nearest[0] = (least, block * BLOCK + first);
        });
        let Some(&(length, next)) = nearest.iter().min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        edges.push(Edge { ends: [last, next], length });
        reach[next] = JOINED;
        last = next;
    }
    edges
}

/// Two parts that become one. Parts below N are points, part N + i is the result of merge i.
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

/// The current root of a part, with path compression.
fn root(parents: &mut [usize], mut part: usize) -> usize {
    while parents[part] != part {
        parents[part] = parents[parents[part]];
        part = parents[part];
    }
    part
}
