//! Tests of pictures as Gaussians.

#[cfg(feature = "command")]
mod command;
mod drawing;
mod files;
mod fits;
mod gradients;
mod judging;
mod random;
mod reader;
mod refusals;
mod scales;
mod starts;
