//! Allocation by the router's own choice of expert for every pixel.

use super::{Allocation, AllocationRequest, Assignment, GumbelGate};
use crate::gumbel::argmax;
use weaver_autograd::Real;

/// The published temperature.
const TEMPERATURE: f64 = 0.5;

fn choose<T: Real>(request: &AllocationRequest<'_, T>, noise: Vec<T>) -> Assignment<T> {
    let experts = request.experts();
    let row = |values: &'_ [T], p: usize| p * experts..((p + 1) * experts).min(values.len());
    let expert = (0..request.pixels())
        .map(|p| {
            let noise = (!noise.is_empty()).then(|| &noise[row(&noise, p)]);
            argmax(&request.logits[row(request.logits, p)], noise) as u8
        })
        .collect();
    Assignment { expert, gate: Some(GumbelGate { temperature: TEMPERATURE, noise }) }
}

/// The published allocation: every pixel's expert is a sample of softmax(logits), by Gumbel noise of the request's
/// stream (or the noise given with the request); training and inference alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampled;

impl<T: Real> Allocation<T> for Sampled {
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T> {
        let noise = match request.gumbel {
            Some(noise) => noise.to_vec(),
            None => (0..request.logits.len() as u64).map(|i| request.stream.gumbel(i)).collect(),
        };
        choose(request, noise)
    }
}

/// Every pixel's most likely expert: no noise, far fewer Gaussians than the samples have on average.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Argmax;

impl<T: Real> Allocation<T> for Argmax {
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T> {
        choose(request, Vec::new())
    }
}

/// The same expert for every pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fixed {
    /// The expert: Gaussians per pixel.
    pub expert: u8,
}

impl<T: Real> Allocation<T> for Fixed {
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T> {
        Assignment::plain(vec![self.expert; request.pixels()])
    }
}
