//! Processes that share the batches of a step.

use crate::Error;
use std::fmt::Debug;
use std::ops::Range;

/// The processes of one run. Each computes the gradients of some of a step's batches
/// ([`OptimizerConfig::accumulate`](crate::OptimizerConfig::accumulate)); all hold the same weights.
///
/// [`Alone`] is one process; an implementation for several passes numbers from one to another. A failure of the others is none that a method
/// reports: it ends the processes.
pub trait Ranks: Debug + Send + Sync {
    /// Number of this process, from 0.
    fn rank(&self) -> usize;

    /// Number of processes.
    fn size(&self) -> usize;

    /// Sends numbers to another process, which [receives](Self::receive) as many.
    fn send(&self, values: &[f32], to: usize);

    /// Receives numbers that another process [sends](Self::send).
    fn receive(&self, values: &mut [f32], from: usize);

    /// Replaces the numbers of all processes by those of process 0.
    fn broadcast(&self, values: &mut [f32]);

    /// A word of each process, in the order of their numbers, on all of them.
    fn gather(&self, word: u64) -> Vec<u64>;
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

/// The process that computes a batch: consecutive ones, as evenly as can be.
fn owner(batch: usize, batches: usize, ranks: &dyn Ranks) -> usize {
    batch * ranks.size() / batches
}

/// The sum of rows, one for each of `batches`, on all processes.
///
/// It is made by a binary tree over the batches, so that its bits do not depend on how many processes there are: a node is the sum of its
/// first half and its second half, in this order.
///
/// # Errors
/// As `row`, on the process that fails alone.
pub(crate) fn sum(
    ranks: &dyn Ranks,
    batches: usize,
    mut row: impl FnMut(usize) -> Result<Vec<f32>, Error>,
) -> Result<Vec<f32>, Error> {
    // Every process has the first of its batches at least, and the length of all rows from there.
    let mut length = 0;
    let mut row = |batch: usize| row(batch).inspect(|row| length = row.len());
    let mut all = node(ranks, 0..batches, batches, &mut row)?;
    all.resize(length, 0.0);
    ranks.broadcast(&mut all);
    Ok(all)
}

/// The sum of a range of rows on the process that owns the first of them; nothing elsewhere.
fn node(
    ranks: &dyn Ranks,
    range: Range<usize>,
    batches: usize,
    row: &mut impl FnMut(usize) -> Result<Vec<f32>, Error>,
) -> Result<Vec<f32>, Error> {
    let own = |batch: usize| owner(batch, batches, ranks);
    let here = own(range.start)..=own(range.end - 1);
    if !here.contains(&ranks.rank()) {
        return Ok(Vec::new());
    }
    if range.len() == 1 {
        return row(range.start);
    }
    let middle = range.start + range.len() / 2;
    let mut first = node(ranks, range.start..middle, batches, row)?;
    let mut second = node(ranks, middle..range.end, batches, row)?;
    let (to, from) = (own(range.start), own(middle));
    if to != from && ranks.rank() == from {
        ranks.send(&second, to);
    }
    if ranks.rank() != to {
        return Ok(Vec::new());
    }
    if to != from {
        second = vec![0.0; first.len()];
        ranks.receive(&mut second, from);
    }
    first.iter_mut().zip(&second).for_each(|(a, b)| *a += b);
    Ok(first)
}
