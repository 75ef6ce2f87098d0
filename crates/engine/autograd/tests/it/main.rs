//! Tests of the tape and of every built-in op.

mod activations;
mod adjoints;
mod attention;
mod convolution;
mod gradcheck;
mod losses;
mod matmul;
mod normalization;
mod parity;
mod rearrange;
mod release;
mod shapes;
mod spatial;
mod strategies;
mod tape;
mod threads;
mod top_k;
