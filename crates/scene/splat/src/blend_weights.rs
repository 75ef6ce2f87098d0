//! The weights that pictures are made of, kept, so that other features are blended without drawing anew.

#[cfg(feature = "tape")]
mod blend;

use crate::error::RasterError;
use crate::workspace::Workspace;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
use weaver_kernels::Real;

/// The Gaussians that each pixel shows, front to back, each with its weight alpha T.
///
/// A sparse matrix W `[P, N]` of the P pixels of all pictures of a drawing. Where Gaussians and cameras stay, features
/// F `[N, C]` that change are blended by W F and gather gradients by its transpose, for far less than a drawing: 8
/// bytes for each hit instead.
#[derive(Clone, Debug, PartialEq)]
pub struct BlendWeights<T> {
    /// Start of each pixel's hits, and the end of the last pixel's, `[P + 1]`.
    starts: Vec<u32>,
    /// The Gaussian of each hit, 0 to N - 1.
    hits: Vec<u32>,
    /// alpha T of each hit.
    weights: Vec<T>,
    gaussians: usize,
}

impl<T: Real> BlendWeights<T> {
    /// The weights of the last image drawn with a workspace.
    ///
    /// # Errors
    /// A workspace that nothing was drawn with, or more than 2^32 hits.
    pub fn of(workspace: &Workspace<T>) -> Result<Self, RasterError> {
        let (extent, _) = workspace.last()?;
        // The hits of a pixel come one after the other, on one thread: relaxed counts keep their order.
        let cursors: Vec<AtomicU32> = (0..extent.pixels()).map(|_| AtomicU32::new(0)).collect();
        workspace.for_each_hit(|pixel, _, _, _| {
            cursors[pixel].fetch_add(1, Relaxed);
        })?;
        let count: u64 = cursors.iter().map(|count| u64::from(count.load(Relaxed))).sum();
        if count > u64::from(u32::MAX) {
            return Err(RasterError::TooMany(format!("{count} hits are too many to be kept")));
        }
        let mut starts = vec![0];
        for (pixel, cursor) in cursors.iter().enumerate() {
            let start = starts[pixel];
            starts.push(start + cursor.swap(start, Relaxed));
        }
        let hits: Vec<AtomicU32> = (0..count).map(|_| AtomicU32::new(0)).collect();
        let bits: Vec<AtomicU64> = (0..count).map(|_| AtomicU64::new(0)).collect();
        workspace.for_each_hit(|pixel, gaussian, weight, _| {
            let place = cursors[pixel].fetch_add(1, Relaxed) as usize;
            hits[place].store(gaussian as u32, Relaxed);
            bits[place].store(weight.to_f64().to_bits(), Relaxed);
        })?;
        let weight = |bits: AtomicU64| T::from_f64(f64::from_bits(bits.into_inner()));
        let (hits, weights) = (hits.into_iter().map(AtomicU32::into_inner), bits.into_iter().map(weight));
        Ok(Self { starts, hits: hits.collect(), weights: weights.collect(), gaussians: extent.gaussians })
    }

    /// P, the pixels of all pictures: `[V, H, W]`, `[V, K, H, W]` of Gaussians in groups.
    pub fn pixels(&self) -> usize {
        self.starts.len() - 1
    }

    /// N, the Gaussians that were drawn.
    pub fn gaussians(&self) -> usize {
        self.gaussians
    }

    /// The hits of a pixel, front to back: Gaussians and their weights.
    pub fn of_pixel(&self, pixel: usize) -> impl Iterator<Item = (usize, T)> {
        let range = self.starts[pixel] as usize..self.starts[pixel + 1] as usize;
        self.hits[range.clone()].iter().map(|hit| *hit as usize).zip(self.weights[range].iter().copied())
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.starts) + size_of_val(&*self.hits) + size_of_val(&*self.weights)
    }
}
