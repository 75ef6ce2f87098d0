//! Tests of pictures as Gaussians.

mod drawing;
mod gradients;
mod random;
mod refusals;
mod scales;
