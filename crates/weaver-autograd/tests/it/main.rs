//! Tests of the tape and of every built-in op.

mod activations;
mod attention;
mod convolution;
mod losses;
mod matmul;
mod normalisation;
mod rearrange;
mod strategies;
mod tape;
