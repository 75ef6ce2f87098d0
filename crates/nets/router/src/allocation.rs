//! Allocation strategies: which pixels get how many Gaussians.

mod bayer;
mod choice;
mod kind;
mod masked;
mod quadtree;
mod thinning;

pub use choice::{Argmax, Fixed, Sampled};
pub use kind::{AllocationError, AllocationKind};
pub use masked::Masked;
pub use quadtree::{Quadtree, QuadtreeGrid, QuadtreeMix};
pub use thinning::{Dithered, Grid, Random, TrainingMix};

use crate::cell::{Cell, Cells};
use crate::gumbel::gumbel_softmax_straight_through;
use std::fmt::Debug;
use thinning::Place;
use weaver_autograd::{Buffer, Pool, Real, Var};
use weaver_kernels::random::Stream;

/// The input of an allocation: one scene of V views with H x W pixels, P = V H W in all, in (view, row, column) order.
#[derive(Clone, Copy, Debug)]
pub struct AllocationRequest<'a, T: Real = f32> {
    /// The router's logits `[P, E]`, where E is 1 plus the largest number of Gaussians per pixel.
    pub logits: &'a [T],
    /// High-frequency energy `[P]` of the images.
    pub energy: &'a [T],
    /// The photos `[V, 3, H, W]`, 0 to 1. Only [`Quadtree`] looks at them, for all others they may be empty.
    pub photos: &'a [T],
    /// Depth `[P]`, where it is known; only [`Quadtree`] looks at it.
    pub depth: Option<&'a [T]>,
    /// Number of views V.
    pub views: usize,
    /// Rows H of a view.
    pub height: usize,
    /// Columns W of a view.
    pub width: usize,
    /// Mask `[P]` of the pixels that count: a budget is for these, and only they get Gaussians ([`Masked`]). `None` if
    /// all do.
    pub inside: Option<&'a [bool]>,
    /// Source of the noise.
    pub stream: Stream,
    /// Gumbel noise `[P, E]` to use instead of the stream's, so that a known sample can be repeated.
    pub gumbel: Option<&'a [T]>,
    /// Pool from which the assignment takes its memory.
    pub pool: &'a Pool,
}

impl<T: Real> AllocationRequest<'_, T> {
    /// Number of pixels P.
    pub fn pixels(&self) -> usize {
        self.views * self.height * self.width
    }

    /// Number of experts E, expert 0 included.
    pub fn experts(&self) -> usize {
        self.logits.len() / self.pixels().max(1)
    }

    /// Number of pixels that count.
    pub fn pixels_inside(&self) -> usize {
        self.inside.map_or(self.pixels(), |inside| inside.iter().filter(|inside| **inside).count())
    }

    fn places(&self) -> impl Iterator<Item = Place> {
        let (height, width) = (self.height, self.width);
        (0..self.pixels()).map(move |pixel| Place {
            pixel,
            view: pixel / (height * width),
            row: pixel / width % height,
            column: pixel % width,
        })
    }
}

/// A strategy that decides how many Gaussians each pixel gets.
pub trait Allocation<T: Real = f32>: Debug + Send + Sync {
    /// Chooses an expert for every pixel.
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T>;
}

/// The number of Gaussians of each pixel, and how a gradient reaches this choice.
#[derive(Debug)]
pub struct Assignment<T: Real = f32> {
    /// The expert of each pixel `[P]`: expert e makes e Gaussians.
    pub expert: Buffer<u8>,
    /// The cells whose first pixels these are; `None` where each pixel stands for itself.
    pub cells: Option<Cells>,
    /// Inputs of the choice's gradient, where the router itself made it; `None` where it had no part in it.
    pub gate: Option<GumbelGate<T>>,
}

/// Inputs of the straight-through gradient of a choice.
#[derive(Debug)]
pub struct GumbelGate<T: Real = f32> {
    /// The Gumbel noise `[P, E]` that was added to the logits; `None` if none was.
    pub noise: Option<Buffer<T>>,
}

impl<T: Real> Assignment<T> {
    /// An assignment through which no gradient reaches the router.
    pub fn plain(expert: Buffer<u8>) -> Self {
        Self { expert, cells: None, gate: None }
    }

    /// Number of Gaussians of all pixels together.
    pub fn count(&self) -> usize {
        self.expert.iter().map(|&e| usize::from(e)).sum()
    }

    /// Gaussians per pixel around each pixel `[P]` of views of this size: of a cell, its number over its pixels.
    pub fn density(&self, [height, width]: [usize; 2]) -> Vec<f32> {
        let Some(cells) = &self.cells else { return self.expert.iter().map(|&e| f32::from(e)).collect() };
        let mut density = vec![0.0; self.expert.len()];
        for (pixel, &e) in self.expert.iter().enumerate().filter(|(_, e)| **e > 0) {
            let first = pixel / (height * width) * height;
            let cell = Cell { row: pixel / width % height, column: pixel % width, level: cells.level[pixel] };
            let (rows, columns) = (cell.rows(height), cell.columns(width));
            let own = f32::from(e) / (rows.len() * columns.len()) as f32;
            for row in rows {
                density[(first + row) * width..][columns.clone()].fill(own);
            }
        }
        density
    }

    /// The one-hot choice `[P, E]`, with the straight-through gradient of a softmax of `logits` at this temperature
    /// (0.5 as published); `None` where the router had no part in the choice.
    pub fn choice<'t>(&self, logits: Var<'t, T>, temperature: f64) -> Option<Var<'t, T>> {
        let gate = self.gate.as_ref()?;
        let noise = gate.noise.as_ref().map(|noise| logits.tape().constant(noise, logits.shape()));
        Some(gumbel_softmax_straight_through(logits, noise, temperature))
    }
}
