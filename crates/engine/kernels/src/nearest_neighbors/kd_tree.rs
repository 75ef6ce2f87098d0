//! An exact k-d tree over points in three dimensions.
//!
//! Points are split by rank, not by coordinate, so many points in the same place are no special case. A query allocates
//! nothing.

use crate::Real;

/// The most points that a leaf holds.
const LEAF: usize = 8;

type Point<T> = [T; 3];

/// The splitting plane of an inner node: coordinate `axis` is at most `at` in the left child and at least `at` in the
/// right child.
#[derive(Clone, Copy, Debug, Default)]
struct Split<T> {
    axis: u8,
    at: T,
}

/// A balanced tree: every node owns a range of points and splits it in the middle, down to leaves of [`LEAF`] points.
#[derive(Debug)]
pub(super) struct KdTree<T: Real> {
    /// In the order of the leaves.
    points: Vec<Point<T>>,
    /// The index that each of `points` had in the caller's slice.
    index: Vec<u32>,
    /// Node 1 is the root; node n has the children 2 n and 2 n + 1.
    splits: Vec<Split<T>>,
}

/// The nearest points found so far, nearest first; of equally near ones the lower index first.
struct Nearest<'a, T> {
    index: &'a mut [u32],
    distance: &'a mut [T],
    found: usize,
}

impl<T: Real> Nearest<'_, T> {
    /// The squared distance that a point must beat.
    fn limit(&self) -> T {
        if self.found < self.index.len() { T::INFINITY } else { self.distance[self.found - 1] }
    }

    fn offer(&mut self, index: u32, distance: T) {
        let before = |other: usize, this: &Self| {
            this.distance[other] < distance || (this.distance[other] == distance && this.index[other] < index)
        };
        let full = self.found == self.index.len();
        if full && before(self.found - 1, self) {
            return;
        }
        let mut at = if full { self.found - 1 } else { self.found };
        while at > 0 && !before(at - 1, self) {
            self.index[at] = self.index[at - 1];
            self.distance[at] = self.distance[at - 1];
            at -= 1;
        }
        self.index[at] = index;
        self.distance[at] = distance;
        self.found += usize::from(!full);
    }
}

impl<T: Real> KdTree<T> {
    /// Builds the tree of `points` `[N, 3]`.
    pub fn new(points: &[T]) -> Self {
        let point = |i: usize| [points[3 * i], points[3 * i + 1], points[3 * i + 2]];
        let n = points.len() / 3;
        let mut index: Vec<u32> = (0..n as u32).collect();
        let mut inner = 1;
        while inner * LEAF < n {
            inner *= 2;
        }
        let mut splits = vec![Split::default(); inner];
        split(&mut index, &mut splits, 1, &point);
        let points = index.iter().map(|&i| point(i as usize)).collect();
        Self { points, index, splits }
    }

    /// Fills `index` with the points nearest to `query`, nearest first, never with point `exclude`; `distance` is
    /// scratch space of the same length. Returns how many points were found.
    pub fn nearest(&self, query: Point<T>, exclude: u32, index: &mut [u32], distance: &mut [T]) -> usize {
        if index.is_empty() {
            return 0;
        }
        let mut nearest = Nearest { index, distance, found: 0 };
        self.visit(query, exclude, &mut nearest, 1, 0..self.points.len(), [T::ZERO; 3]);
        nearest.found
    }

    /// Searches a node whose cell is `offset` away from the query along each axis.
    fn visit(
        &self,
        query: Point<T>,
        exclude: u32,
        nearest: &mut Nearest<'_, T>,
        node: usize,
        range: std::ops::Range<usize>,
        offset: Point<T>,
    ) {
        if range.len() <= LEAF {
            for (p, &i) in self.points[range.clone()].iter().zip(&self.index[range]) {
                let [x, y, z] = [p[0] - query[0], p[1] - query[1], p[2] - query[2]];
                let distance = x * x + y * y + z * z;
                // False for NaN: a point with such a coordinate is never a neighbor.
                if distance <= nearest.limit() && i != exclude {
                    nearest.offer(i, distance);
                }
            }
            return;
        }
        let Split { axis, at } = self.splits[node];
        let axis = usize::from(axis);
        let middle = range.start + range.len() / 2;
        let [low, high] = [(2 * node, range.start..middle), (2 * node + 1, middle..range.end)];
        let away = query[axis] - at;
        let (near, far) = if away < T::ZERO { (low, high) } else { (high, low) };
        self.visit(query, exclude, nearest, near.0, near.1, offset);
        let mut beyond = offset;
        beyond[axis] = away;
        // In the order in which distances are summed, so that rounding cannot put a point nearer than its cell.
        let reach = beyond[0] * beyond[0] + beyond[1] * beyond[1] + beyond[2] * beyond[2];
        if reach < nearest.limit() {
            self.visit(query, exclude, nearest, far.0, far.1, beyond);
        }
    }
}

/// Orders `index` so that the two halves of every node lie on the two sides of its plane, across the widest axis.
fn split<T: Real>(index: &mut [u32], splits: &mut [Split<T>], node: usize, point: &impl Fn(usize) -> Point<T>) {
    if index.len() <= LEAF {
        return;
    }
    let (mut low, mut high) = ([T::INFINITY; 3], [-T::INFINITY; 3]);
    for &i in index.iter() {
        let p = point(i as usize);
        for a in 0..3 {
            low[a] = low[a].min(p[a]);
            high[a] = high[a].max(p[a]);
        }
    }
    let wider = |a: usize, b: usize| if high[b] - low[b] > high[a] - low[a] { b } else { a };
    let axis = wider(wider(0, 1), 2);
    let key = |i: u32| point(i as usize)[axis].to_f64();
    let middle = index.len() / 2;
    // By coordinate, then index: a total order, also of equal points and of NaN.
    index.select_nth_unstable_by(middle, |&a, &b| key(a).total_cmp(&key(b)).then(a.cmp(&b)));
    splits[node] = Split { axis: axis as u8, at: point(index[middle] as usize)[axis] };
    let (left, right) = index.split_at_mut(middle);
    split(left, splits, 2 * node, point);
    split(right, splits, 2 * node + 1, point);
}
