//! Allocation by the router's own choice of expert for every pixel.

use super::{Allocation, AllocationRequest, Assignment, GumbelGate};
use crate::gumbel::argmax;
use weaver_autograd::{Buffer, Real};

fn choose<T: Real>(request: &AllocationRequest<'_, T>, noise: Option<Buffer<T>>) -> Assignment<T> {
    let experts = request.experts();
    let mut expert = request.pool.buffer::<u8>(request.pixels());
    for (p, chosen) in expert.iter_mut().enumerate() {
        let row = p * experts..(p + 1) * experts;
        *chosen = argmax(&request.logits[row.clone()], noise.as_ref().map(|noise| &noise[row])) as u8;
    }
    Assignment { expert, cells: None, gate: Some(GumbelGate { noise }) }
}

/// The published allocation: every pixel's expert is a sample of softmax(logits).
///
/// The sample is drawn with Gumbel noise from the request's stream, or with the noise given in the request, in training
/// and inference alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampled;

impl<T: Real> Allocation<T> for Sampled {
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T> {
        let noise = match request.gumbel {
            Some(noise) => request.pool.copy_of(noise),
            None => {
                let mut noise = request.pool.buffer(request.logits.len());
                noise.iter_mut().enumerate().for_each(|(i, n)| *n = request.stream.gumbel(i as u64));
                noise
            }
        };
        choose(request, Some(noise))
    }
}

/// Gives every pixel its most likely expert, without noise. Usually this makes far fewer Gaussians than sampling.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Argmax;

impl<T: Real> Allocation<T> for Argmax {
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T> {
        choose(request, None)
    }
}

/// Gives every pixel the same number of Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fixed {
    /// The expert of every pixel, which is its number of Gaussians.
    pub expert: u8,
}

impl<T: Real> Allocation<T> for Fixed {
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T> {
        Assignment::plain(request.pool.filled(request.pixels(), self.expert))
    }
}
