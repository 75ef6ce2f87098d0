//! Processes that share the parts of a sum, and the tree that makes its bits independent of their number.
//!
//! ```
//! use weaver_ranks::{sum, threads};
//! let row = |part: usize| Ok::<_, ()>(vec![0.1 + part as f32]);
//! let summed = |count: usize| {
//!     let ranks = threads(count).into_iter();
//!     let workers: Vec<_> = ranks.map(|ranks| std::thread::spawn(move || sum(&*ranks, 5, row).unwrap())).collect();
//!     workers.into_iter().map(|worker| worker.join().unwrap()).collect::<Vec<_>>()
//! };
//! let alone = summed(1);
//! assert_eq!(summed(3), vec![alone[0].clone(); 3]);
//! ```
//!
//! With the feature `mpi` there are the processes of an MPI; it needs one with its headers (Open MPI, MPICH), and
//! libclang.

#[cfg_attr(not(feature = "mpi"), path = "no_processes.rs")]
mod processes;
mod threads;

pub use processes::Processes;
pub use threads::threads;

use std::fmt::Debug;
use std::ops::Range;

/// The processes of one run. Each computes some of the parts of a sum; all hold the same state.
///
/// [`Alone`] is one process; an implementation for several passes numbers from one to another. A failure of the others
/// is none that a method reports: it ends the processes.
pub trait Ranks: Debug + Send + Sync {
    /// Number of this process, from 0.
    fn rank(&self) -> usize;

    /// Number of processes.
    fn size(&self) -> usize;

    /// Sends numbers to another process, which [receives](Self::receive) as many.
    fn send(&self, values: &[f32], to: usize);

    /// Receives numbers that another process [sends](Self::send).
    fn receive(&self, values: &mut [f32], from: usize);

    /// Replaces the numbers of all processes by process 0's.
    fn broadcast(&self, values: &mut [f32]);

    /// A word of each process, in the order of their numbers, on all of them.
    fn gather(&self, word: u64) -> Vec<u64>;

    /// The word of process 0, on all processes.
    fn agreed(&self, word: u64) -> u64 {
        self.gather(word)[0]
    }

    /// The first process whose word differs from process 0's, on all processes.
    fn other(&self, word: u64) -> Option<usize> {
        let words = self.gather(word);
        words.iter().position(|word| *word != words[0])
    }
}

/// A run of one process.
#[derive(Clone, Copy, Debug, Default)]
pub struct Alone;

impl Ranks for Alone {
    fn rank(&self) -> usize {
        0
    }

    fn size(&self) -> usize {
        1
    }

    fn send(&self, _: &[f32], _: usize) {}

    fn receive(&self, _: &mut [f32], _: usize) {}

    fn broadcast(&self, _: &mut [f32]) {}

    fn gather(&self, word: u64) -> Vec<u64> {
        vec![word]
    }
}

/// The text of process 0, on all processes.
pub fn agreed_text(ranks: &dyn Ranks, text: &str) -> String {
    let length = ranks.agreed(text.len() as u64) as usize;
    // A byte as a number passes unchanged, even if the network rounds or converts numbers.
    let mut bytes: Vec<f32> = text.bytes().map(f32::from).collect();
    bytes.resize(length, 0.0);
    ranks.broadcast(&mut bytes);
    String::from_utf8_lossy(&bytes.iter().map(|byte| *byte as u8).collect::<Vec<_>>()).into_owned()
}

/// The process that computes a part; each has consecutive parts, as evenly as possible.
fn owner(part: usize, parts: usize, ranks: &dyn Ranks) -> usize {
    part * ranks.size() / parts
}

/// The sum of rows of equal length, one for each of `parts`, on all processes: [`joined`] by addition.
///
/// # Errors
/// As `row`, on the process that fails alone.
pub fn sum<E>(ranks: &dyn Ranks, parts: usize, row: impl FnMut(usize) -> Result<Vec<f32>, E>) -> Result<Vec<f32>, E> {
    joined(ranks, parts, row, |first, second| first.iter_mut().zip(second).for_each(|(a, b)| *a += b))
}

/// Rows of equal length, one for each of `parts`, joined on all processes; there are at most as many processes as
/// parts.
///
/// It is done by a binary tree over the parts, so that the bits do not depend on how many processes there are: `join`
/// makes a node of its first half, which it changes, and of its second half, in this order. `row` is called for
/// consecutive parts on each process.
///
/// # Errors
/// As `row`, on the process that fails alone.
pub fn joined<E>(
    ranks: &dyn Ranks,
    parts: usize,
    mut row: impl FnMut(usize) -> Result<Vec<f32>, E>,
    join: impl Fn(&mut [f32], &[f32]),
) -> Result<Vec<f32>, E> {
    // Every process has at least one part, and the length of all rows from there.
    let mut length = 0;
    let mut row = |part: usize| row(part).inspect(|row| length = row.len());
    let mut all = Tree { ranks, parts, join }.node(0..parts, &mut row)?;
    all.resize(length, 0.0);
    ranks.broadcast(&mut all);
    Ok(all)
}

struct Tree<'a, J> {
    ranks: &'a dyn Ranks,
    parts: usize,
    join: J,
}

impl<J: Fn(&mut [f32], &[f32])> Tree<'_, J> {
    /// The join of a range of rows on the process that owns the first of them; nothing elsewhere.
    fn node<E>(&self, range: Range<usize>, row: &mut impl FnMut(usize) -> Result<Vec<f32>, E>) -> Result<Vec<f32>, E> {
        let (rank, own) = (self.ranks.rank(), |part: usize| owner(part, self.parts, self.ranks));
        let here = own(range.start)..=own(range.end - 1);
        if !here.contains(&rank) {
            return Ok(Vec::new());
        }
        if range.len() == 1 {
            return row(range.start);
        }
        let middle = range.start + range.len() / 2;
        let mut first = self.node(range.start..middle, row)?;
        let mut second = self.node(middle..range.end, row)?;
        let (to, from) = (own(range.start), own(middle));
        if to != from && rank == from {
            self.ranks.send(&second, to);
        }
        if rank != to {
            return Ok(Vec::new());
        }
        if to != from {
            second = vec![0.0; first.len()];
            self.ranks.receive(&mut second, from);
        }
        (self.join)(&mut first, &second);
        Ok(first)
    }
}

/// The bandwidth above which two processes are faster than one, bytes a second, where each sends and receives `bytes` a
/// step. A step has `parts` parts of `seconds` each; one part is taken for two.
///
/// ```
/// use weaver_ranks::least_bandwidth;
/// // 10 MB and back take 0.2 s at 100 MB/s; of four parts, two of 0.1 s are saved, and of three parts one.
/// assert_eq!(least_bandwidth(10_000_000, 4, 0.1), 100e6);
/// assert_eq!(least_bandwidth(10_000_000, 3, 0.1), 200e6);
/// assert_eq!(least_bandwidth(10_000_000, 1, 0.1), least_bandwidth(10_000_000, 2, 0.1));
/// ```
pub fn least_bandwidth(bytes: u64, parts: usize, seconds: f64) -> f64 {
    let parts = parts.max(2);
    2.0 * bytes as f64 / ((parts - parts.div_ceil(2)) as f64 * seconds)
}

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
