//! An exact k-d tree over points in three dimensions.
//!
//! Our own, because the crates at hand allocate for every query and treat many points in one place as an error or a
//! slow case; here points are split by rank, so equal ones are nothing special.

use weaver_autograd::{Buffer, Pool, Real};

/// Points that a leaf holds at most.
const LEAF: usize = 8;

type Point<T> = [T; 3];

/// The cut of an inner node: points to the left are not above `at` on `axis`, points to the right not below.
#[derive(Clone, Copy, Debug, Default)]
struct Cut<T> {
    axis: u8,
    at: T,
}

/// A balanced tree: the node of a range of points splits it in the middle, down to leaves of [`LEAF`] points.
#[derive(Debug)]
pub(crate) struct KdTree<T: Real> {
    points: Buffer<Point<T>>,
    /// The index that each of `points` had.
    index: Buffer<u32>,
    /// Node 1 is the root; node n has the children 2 n and 2 n + 1.
    cuts: Buffer<Cut<T>>,
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
    pub fn new(points: &[T], pool: &Pool) -> Self {
        let point = |i: usize| [points[3 * i], points[3 * i + 1], points[3 * i + 2]];
        let n = points.len() / 3;
        let mut index = pool.buffer::<u32>(n);
        index.iter_mut().enumerate().for_each(|(i, x)| *x = i as u32);
        let mut inner = 1;
        while inner * LEAF < n {
            inner *= 2;
        }
        let mut cuts = pool.filled(inner, Cut::default());
        split(&mut index, &mut cuts, 1, &point);
        let mut sorted = pool.buffer::<Point<T>>(n);
        sorted.iter_mut().zip(index.iter()).for_each(|(p, &i)| *p = point(i as usize));
        Self { points: sorted, index, cuts }
    }

    /// Fills `index` with the points nearest to `query`, nearest first, leaving out the point numbered `but`;
    /// `distance` is room for as many squared distances. Returns how many there are.
    pub fn nearest(&self, query: Point<T>, but: u32, index: &mut [u32], distance: &mut [T]) -> usize {
        if index.is_empty() {
            return 0;
        }
        let mut nearest = Nearest { index, distance, found: 0 };
        self.visit(query, but, &mut nearest, 1, 0..self.points.len(), [T::ZERO; 3]);
        nearest.found
    }

    /// Looks into a node whose cell is `offset` away from the query, per axis.
    fn visit(
        &self,
        query: Point<T>,
        but: u32,
        nearest: &mut Nearest<'_, T>,
        node: usize,
        range: std::ops::Range<usize>,
        offset: Point<T>,
    ) {
        if range.len() <= LEAF {
            for (p, &i) in self.points[range.clone()].iter().zip(&self.index[range]) {
                let [x, y, z] = [p[0] - query[0], p[1] - query[1], p[2] - query[2]];
                let distance = x * x + y * y + z * z;
                // False for NaN, which is nobody's neighbor.
                if distance <= nearest.limit() && i != but {
                    nearest.offer(i, distance);
                }
            }
            return;
        }
        let Cut { axis, at } = self.cuts[node];
        let axis = usize::from(axis);
        let middle = range.start + range.len() / 2;
        let [low, high] = [(2 * node, range.start..middle), (2 * node + 1, middle..range.end)];
        let away = query[axis] - at;
        let (near, far) = if away < T::ZERO { (low, high) } else { (high, low) };
        self.visit(query, but, nearest, near.0, near.1, offset);
        let mut beyond = offset;
        beyond[axis] = away;
        // Summed as distances are, so that rounding cannot put a point nearer than its cell.
        let reach = beyond[0] * beyond[0] + beyond[1] * beyond[1] + beyond[2] * beyond[2];
        if reach < nearest.limit() {
            self.visit(query, but, nearest, far.0, far.1, beyond);
        }
    }
}

/// Orders `index` so that every node's halves lie on the two sides of its cut, across the widest axis.
fn split<T: Real>(index: &mut [u32], cuts: &mut [Cut<T>], node: usize, point: &impl Fn(usize) -> Point<T>) {
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
    cuts[node] = Cut { axis: axis as u8, at: point(index[middle] as usize)[axis] };
    let (left, right) = index.split_at_mut(middle);
    split(left, cuts, 2 * node, point);
    split(right, cuts, 2 * node + 1, point);
}
