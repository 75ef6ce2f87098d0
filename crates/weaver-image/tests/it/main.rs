//! Tests of pictures as Gaussians.

mod drawing;
mod fits;
mod gradients;
mod judging;
mod random;
mod refusals;
mod scales;
mod starts;
