//! Lists of each Gaussian's nearest neighbors, and the reverse lists that gradients need.

use std::ops::Range;
use std::sync::Arc;
use weaver_autograd::{Buffer, Pool, Real};
use weaver_kernels::nearest_neighbors::nearest_neighbors;

/// Gaussians per parallel chunk.
pub(crate) const GRAIN: usize = 256;

/// Lists of nearest neighbors: for each of R Gaussians m = k + 1 indices, itself and its k nearest neighbors among all
/// N.
///
/// All Gaussians have a list (R = N), except in a [`part`](Neighbors::part). Cheap to clone.
#[derive(Clone, Debug)]
pub struct Neighbors {
    lists: Arc<Lists>,
    /// The Gaussians whose lists these are.
    rows: Range<usize>,
}

#[derive(Debug)]
struct Lists {
    per_gaussian: usize,
    /// `[N, m]`
    index: Buffer<u32>,
    /// Start of the reverse list of each Gaussian `[N + 1]`.
    start: Buffer<u32>,
    /// Reverse lists end to end: positions in `index` at which a Gaussian is named, ascending `[N m]`.
    named_at: Buffer<u32>,
}

impl Neighbors {
    /// Finds the k nearest neighbors of each of `means` `[N, 3]`, exactly; see [`nearest_neighbors`]. Not
    /// differentiable.
    pub fn search<T: Real>(means: &[T], k: usize, pool: &Pool) -> Self {
        let mut index = pool.buffer::<u32>(means.len() / 3 * (k + 1));
        nearest_neighbors(means, k, &mut index);
        Self::from_index(index, k + 1, pool)
    }

    /// Takes lists `[N, m]` of indices below N as they are, with m = `per_gaussian`. Panics unless they are whole
    /// lists.
    pub fn from_lists(index: &[u32], per_gaussian: usize, pool: &Pool) -> Self {
        assert_eq!(index.len() % per_gaussian, 0, "every Gaussian has {per_gaussian} neighbors");
        Self::from_index(pool.copy_of(index), per_gaussian, pool)
    }

    fn from_index(index: Buffer<u32>, per_gaussian: usize, pool: &Pool) -> Self {
        let n = index.len() / per_gaussian;
        let mut start = pool.filled::<u32>(n + 1, 0);
        for &j in index.iter() {
            start[j as usize + 1] += 1;
        }
        for j in 0..n {
            start[j + 1] += start[j];
        }
        let mut next = pool.copy_of(&start[..n]);
        let mut named_at = pool.buffer::<u32>(index.len());
        for (position, &j) in index.iter().enumerate() {
            named_at[next[j as usize] as usize] = position as u32;
            next[j as usize] += 1;
        }
        Self { lists: Arc::new(Lists { per_gaussian, index, start, named_at }), rows: 0..n }
    }

    /// The lists of the Gaussians `rows` of this one, whose neighbors may be any of all N. Panics beyond the last list.
    pub fn part(&self, rows: Range<usize>) -> Self {
        assert!(rows.end <= self.len(), "there are {} lists, not {}", self.len(), rows.end);
        Self { lists: self.lists.clone(), rows: self.rows.start + rows.start..self.rows.start + rows.end }
    }

    /// Number of Gaussians R that have a list.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Number of all Gaussians N.
    pub fn among(&self) -> usize {
        self.lists.start.len() - 1
    }

    /// The Gaussian that the first list belongs to.
    pub(crate) fn first(&self) -> usize {
        self.rows.start
    }

    /// Length m of every list, the Gaussian itself included.
    pub fn per_gaussian(&self) -> usize {
        self.lists.per_gaussian
    }

    /// The lists `[R, m]`, of indices below N.
    pub fn index(&self) -> &[u32] {
        let m = self.per_gaussian();
        &self.lists.index[self.rows.start * m..self.rows.end * m]
    }

    /// The list of the i-th Gaussian that has one.
    pub(crate) fn of(&self, i: usize) -> &[u32] {
        let m = self.per_gaussian();
        &self.index()[i * m..(i + 1) * m]
    }

    /// The positions in the lists at which Gaussian j of all N is named.
    pub(crate) fn naming(&self, j: usize) -> impl Iterator<Item = usize> {
        let all = &self.lists.named_at[self.lists.start[j] as usize..self.lists.start[j + 1] as usize];
        let [start, end] = [self.rows.start, self.rows.end].map(|row| row * self.per_gaussian());
        let before = all.partition_point(|at| (*at as usize) < start);
        all[before..].iter().map(|at| *at as usize).take_while(move |at| *at < end).map(move |at| at - start)
    }

    /// The position of Gaussian j of all N among those that have a list.
    pub(crate) fn own(&self, j: usize) -> Option<usize> {
        self.rows.contains(&j).then(|| j - self.rows.start)
    }
}
