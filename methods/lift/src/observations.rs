//! The features of pixels as the input of lifting.

use crate::error::{LiftError, expect_len};
use std::ops::Range;
use weaver_kernels::Real;

/// Features of the pixels of all views, read a view and some channels at a time, so that they need not fit into memory.
pub trait Observations<T: Real> {
    /// F, the number of channels.
    fn channels(&self) -> usize;

    /// The factor on the features of each pixel of a view, `[R_v]`: 0 masks a pixel out, even one with NaN; the inverse
    /// length makes features into unit vectors.
    ///
    /// # Errors
    /// When they cannot be read, or their number differs.
    fn factors(&mut self, view: usize, factors: &mut [T]) -> Result<(), LiftError>;

    /// Some channels of the features of a view, `[R_v, channels]`, without the factors.
    ///
    /// # Errors
    /// When they cannot be read, or their number differs.
    fn read(&mut self, view: usize, channels: Range<usize>, out: &mut [T]) -> Result<(), LiftError>;
}

/// Features in memory, without masks.
#[derive(Clone, Debug)]
pub struct Maps<T> {
    /// For each view `[R_v, F]`.
    pub views: Vec<Vec<T>>,
    /// F.
    pub channels: usize,
}

impl<T: Real> Observations<T> for Maps<T> {
    fn channels(&self) -> usize {
        self.channels
    }

    fn factors(&mut self, view: usize, factors: &mut [T]) -> Result<(), LiftError> {
        expect_len("features of a view", self.views[view].len(), factors.len() * self.channels)?;
        factors.fill(T::ONE);
        Ok(())
    }

    fn read(&mut self, view: usize, channels: Range<usize>, out: &mut [T]) -> Result<(), LiftError> {
        let values = self.views[view].chunks_exact(self.channels.max(1));
        expect_len("features of a view", out.len(), values.len() * channels.len())?;
        for (out, row) in out.chunks_exact_mut(channels.len().max(1)).zip(values) {
            out.copy_from_slice(&row[channels.clone()]);
        }
        Ok(())
    }
}
