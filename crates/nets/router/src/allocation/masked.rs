//! Allocation to some of the pixels.

use super::{Allocation, AllocationRequest, Assignment};
use weaver_autograd::Real;

/// An allocation that gives Gaussians to no pixel that does not count.
///
/// Its budget is for the pixels that do. The router's choice elsewhere keeps its gradient, which no Gaussian feeds.
#[derive(Clone, Copy, Debug)]
pub struct Masked<'a, T: Real = f32> {
    /// Who chooses.
    pub among: &'a dyn Allocation<T>,
    /// Mask `[P]` of the pixels that count; `None` if all do.
    pub inside: Option<&'a [bool]>,
}

impl<T: Real> Allocation<T> for Masked<'_, T> {
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T> {
        let mut assignment = self.among.allocate(&AllocationRequest { inside: self.inside, ..*request });
        for (expert, inside) in assignment.expert.iter_mut().zip(self.inside.into_iter().flatten()) {
            *expert *= u8::from(*inside);
        }
        assignment
    }
}
