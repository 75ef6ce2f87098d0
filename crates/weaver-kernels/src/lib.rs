//! Plain numeric kernels on slices for `f32` and `f64`: GEMM, convolution, attention, norms, resizing.
//!
//! A kernel is a function: the caller owns all memory, shapes are arguments, nothing knows of a tape.
//! Every parallel kernel writes disjoint parts, and what it writes does not depend on the number of threads: where borders do,
//! no sum crosses one.

pub mod attention;
pub mod conv;
pub mod erf;
pub mod exp;
mod extent;
pub mod gelu;
pub mod gemm;
pub mod lanes;
pub mod layer_norm;
pub mod nearest_neighbors;
pub mod optim;
pub mod pages;
pub mod parallel;
pub mod peak;
pub mod permute;
pub mod random;
mod real;
pub mod reduce;
pub mod resample;
pub mod rope;
pub mod rows;
pub mod simd;
pub mod softmax;
mod target;

pub use real::Real;
pub use target::Target;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
