//! Cholesky factorization of a sparse matrix; each row is stored from its first block on.

mod inverse;

use super::linear::fma;
use super::reduced::Reduced;
use super::sums::BLOCK;
use super::system::Row;
use std::cmp::Reverse;
use std::collections::VecDeque;
use weaver_kernels::dense::cholesky;
use weaver_kernels::simd::{self, Level};

/// Sums side by side.
const LANES: usize = 4;
/// Rows of one block, and of the other, whose products are summed at once.
const TALL: usize = 2;
const LONG: usize = 3;

/// A lower triangle, each row from its first block on, and the factor that takes its place: the fill-in of a factor
/// stays within.
#[derive(Clone, Debug)]
pub(super) struct Profile {
    /// The place of each row of the equations: rows with points in common stand near each other.
    place: Vec<u32>,
    /// First stored column of each place.
    first: Vec<u32>,
    /// Start of each place's rows, one after the other up to the end of the block on the diagonal.
    start: Vec<usize>,
    values: Vec<f64>,
    x: Vec<f64>,
}

impl Profile {
    /// The profile of the equations; `None` if a factor takes more products of blocks than `most`.
    ///
    /// Sources: Cuthill and McKee, Reducing the bandwidth of sparse symmetric matrices, 1969, in reverse; George and
    /// Liu, Computer solution of large sparse positive definite systems, 1981, chapter 4.
    pub fn new(reduced: &Reduced, most: usize) -> Option<Self> {
        let n = reduced.rows;
        let place = places(reduced);
        let mut first: Vec<u32> = (0..n as u32).collect();
        for row in 0..n {
            for column in reduced.row(row).0 {
                let [a, b] = [place[row], place[*column as usize]];
                let low = &mut first[a.max(b) as usize];
                *low = (*low).min(a.min(b));
            }
        }
        let mut profile = Self { place, first, start: vec![0], values: Vec::new(), x: vec![0.0; BLOCK * n] };
        if profile.products() > most {
            return None;
        }
        (0..n).for_each(|at| profile.start.push(profile.start[at] + BLOCK * profile.width(at)));
        profile.values = vec![0.0; profile.start[n]];
        Some(profile)
    }

    /// Products of blocks that a factor takes.
    pub fn products(&self) -> usize {
        (0..self.first.len()).map(|at| (self.width(at) / BLOCK).pow(2) / 2).sum()
    }

    fn width(&self, at: usize) -> usize {
        BLOCK * (at + 1 - self.first[at] as usize)
    }

    /// Solves the reduced equations; `false` if their matrix is not positive definite.
    pub fn solve(&mut self, reduced: &Reduced, step: &mut [Row]) -> bool {
        self.load(reduced, |_, _| 1.0);
        if !self.factor() {
            return false;
        }
        let right: Vec<Row> = (0..reduced.rows).map(|row| *reduced.right(row)).collect();
        self.substitute(&right, step);
        true
    }

    /// Copies the matrix, rows and columns times the `unit` of each number of a block.
    pub fn load(&mut self, reduced: &Reduced, unit: impl Fn(usize, usize) -> f64) {
        self.values.fill(0.0);
        for row in 0..reduced.rows {
            let (columns, blocks) = reduced.row(row);
            for (column, block) in columns.iter().map(|c| *c as usize).zip(blocks) {
                for a in 0..BLOCK {
                    for b in 0..BLOCK {
                        let value = block.0[a][b] * unit(row, a) * unit(column, b);
                        if self.place[row] >= self.place[column] {
                            *self.at((row, a), (column, b)) = value;
                        } else {
                            *self.at((column, b), (row, a)) = value;
                        }
                    }
                }
            }
        }
    }

    /// Adds to a number on the diagonal.
    pub fn hold(&mut self, row: usize, k: usize, weight: f64) {
        *self.at((row, k), (row, k)) += weight;
    }

    fn at(&mut self, (row, a): (usize, usize), (column, b): (usize, usize)) -> &mut f64 {
        let (at, column) = (self.place[row] as usize, self.place[column] as usize);
        let within = self.width(at) * a + BLOCK * (column - self.first[at] as usize) + b;
        &mut self.values[self.start[at] + within]
    }

    /// The factor; `false` if the matrix is not positive definite.
    pub fn factor(&mut self) -> bool {
        if simd::level() == Level::Portable {
            return self.factor_by::<false>();
        }
        simd::dispatch(
            #[inline(always)]
            || self.factor_by::<true>(),
        )
    }

    #[inline(always)]
    fn factor_by<const FUSED: bool>(&mut self) -> bool {
        for i in 0..self.first.len() {
            let (above, rest) = self.values.split_at_mut(self.start[i]);
            let first = self.first[i] as usize;
            let width = BLOCK * (i + 1 - first);
            for j in first..=i {
                let from = first.max(self.first[j] as usize);
                let length = BLOCK * (j - from);
                let wide = BLOCK * (j + 1 - self.first[j] as usize);
                let (skip, skip_other) = (BLOCK * (from - first), BLOCK * (from - self.first[j] as usize));
                let here = BLOCK * (j - first);
                let sums = if j < i {
                    let other = &above[self.start[j]..][..BLOCK * wide];
                    products::<FUSED>((&rest[skip..], width), (&other[skip_other..], wide), length)
                } else {
                    products::<FUSED>((&rest[skip..], width), (&rest[skip..], width), length)
                };
                for a in 0..BLOCK {
                    for b in 0..BLOCK {
                        rest[width * a + here + b] -= sums[a][b];
                    }
                }
                if j == i {
                    break;
                }
                let pivot = &above[self.start[j] + wide - BLOCK..];
                for a in 0..BLOCK {
                    let row = &mut rest[width * a + here..][..BLOCK];
                    for b in 0..BLOCK {
                        let sum: f64 = (0..b).map(|c| row[c] * pivot[wide * b + c]).sum();
                        row[b] = (row[b] - sum) / pivot[wide * b + b];
                    }
                }
            }
            if !cholesky(&mut rest[width - BLOCK..], BLOCK, width) {
                return false;
            }
        }
        true
    }

    /// Solves by the factor and its transpose.
    pub fn substitute(&mut self, right: &[Row], solved: &mut [Row]) {
        let mut x = std::mem::take(&mut self.x);
        for (place, right) in self.place.iter().zip(right) {
            x[BLOCK * *place as usize..][..BLOCK].copy_from_slice(&right[..BLOCK]);
        }
        for at in 0..self.first.len() {
            let first = BLOCK * self.first[at] as usize;
            for (row, a) in self.rows(at) {
                let end = BLOCK * at + a;
                x[end] = (x[end] - dot(&row[..end - first], &x[first..end])) / row[end - first];
            }
        }
        for at in (0..self.first.len()).rev() {
            let first = BLOCK * self.first[at] as usize;
            for (row, a) in self.rows(at).rev() {
                let end = BLOCK * at + a;
                x[end] /= row[end - first];
                let by = x[end];
                x[first..end].iter_mut().zip(row).for_each(|(x, l)| *x -= by * l);
            }
        }
        for (place, solved) in self.place.iter().zip(solved) {
            solved[..BLOCK].copy_from_slice(&x[BLOCK * *place as usize..][..BLOCK]);
        }
        self.x = x;
    }

    /// The rows of a place, each with its number.
    fn rows(&self, at: usize) -> impl DoubleEndedIterator<Item = (&[f64], usize)> {
        let all = &self.values[self.start[at]..self.start[at + 1]];
        all.chunks_exact(self.width(at)).zip(0..BLOCK)
    }
}

/// Places of the rows: in the reverse order of Cuthill and McKee from an end of each connected part; rows connected
/// with most others stand last.
fn places(reduced: &Reduced) -> Vec<u32> {
    let n = reduced.rows;
    let mut beside: Vec<Vec<u32>> = vec![Vec::new(); n];
    for row in 0..n {
        for column in reduced.row(row).0.iter().filter(|column| **column as usize != row) {
            beside[row].push(*column);
            beside[*column as usize].push(row as u32);
        }
    }
    let hubs: Vec<usize> = (0..n).filter(|row| 2 * beside[*row].len() > n).collect();
    let mut reached = vec![false; n];
    hubs.iter().for_each(|hub| reached[*hub] = true);
    let mut order: Vec<usize> = Vec::new();
    while let Some(any) = (0..n).filter(|row| !reached[*row]).min_by_key(|row| beside[*row].len()) {
        let far = |from: usize| *walk(&beside, from, &mut reached.clone()).last().expect("itself");
        let end = far(far(any));
        order.extend(walk(&beside, end, &mut reached));
    }
    order.reverse();
    order.extend(hubs);
    let mut place = vec![0; n];
    order.into_iter().enumerate().for_each(|(at, row)| place[row] = at as u32);
    place
}

/// Rows connected with a row, the nearest first, and among rows connected through the same one by rising number of
/// connections.
fn walk(beside: &[Vec<u32>], from: usize, reached: &mut [bool]) -> Vec<usize> {
    let (mut order, mut waiting) = (Vec::new(), VecDeque::from([from]));
    reached[from] = true;
    while let Some(row) = waiting.pop_front() {
        order.push(row);
        let mut next: Vec<usize> = beside[row].iter().map(|b| *b as usize).filter(|b| !reached[*b]).collect();
        next.sort_unstable_by_key(|b| (Reverse(beside[*b].len()), *b));
        while let Some(b) = next.pop() {
            reached[b] = true;
            waiting.push_back(b);
        }
    }
    order
}

/// The products of six rows with six others, of so many numbers.
#[inline(always)]
fn products<const FUSED: bool>(
    (x, wide): (&[f64], usize),
    (y, other): (&[f64], usize),
    length: usize,
) -> [[f64; BLOCK]; BLOCK] {
    let mut all = [[0.0; BLOCK]; BLOCK];
    for a in (0..BLOCK).step_by(TALL) {
        let rows: [&[f64]; TALL] = std::array::from_fn(|i| &x[wide * (a + i)..][..length]);
        for b in (0..BLOCK).step_by(LONG) {
            let columns: [&[f64]; LONG] = std::array::from_fn(|j| &y[other * (b + j)..][..length]);
            let mut sums = [[[0.0; LANES]; LONG]; TALL];
            let whole = length / LANES * LANES;
            for k in (0..whole).step_by(LANES) {
                for i in 0..TALL {
                    let x: &[f64; LANES] = rows[i][k..k + LANES].try_into().expect("as many as lanes");
                    for j in 0..LONG {
                        let y: &[f64; LANES] = columns[j][k..k + LANES].try_into().expect("as many as lanes");
                        (0..LANES).for_each(|l| sums[i][j][l] = fma::<FUSED>(x[l], y[l], sums[i][j][l]));
                    }
                }
            }
            for i in 0..TALL {
                for j in 0..LONG {
                    let rest: f64 = (whole..length).map(|k| rows[i][k] * columns[j][k]).sum();
                    all[a + i][b + j] = sums[i][j].iter().sum::<f64>() + rest;
                }
            }
        }
    }
    all
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
