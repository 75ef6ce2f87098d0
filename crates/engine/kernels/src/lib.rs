//! Numeric kernels on plain slices of `f32` and `f64`: matrix products, convolution, attention, normalization,
//! resizing, reductions, nearest neighbors, greedy division of cells, small dense systems, order statistics,
//! counter-based random numbers, dual numbers, and a [`Pool`] of memory.
//!
//! A kernel is a function. The caller owns all memory and passes shapes as arguments; kernels are independent of
//! automatic differentiation. Results are the same bits at any number of threads: parallel tasks write disjoint parts
//! of the output, and no sum is split where the number of threads decides.
//!
//! Kernels write their result to a [`Target`]: a slice and a factor for its present contents. [`simd`] explains how one
//! source is compiled for several instruction sets.

pub mod attention;
pub mod byte_products;
mod caches;
pub mod conv;
pub mod dense;
mod dual;
pub mod erf;
pub mod exp;
mod extent;
pub mod gelu;
pub mod gemm;
pub mod lanes;
pub mod layer_norm;
pub mod nearest_neighbors;
pub mod optim;
pub mod order;
pub mod pages;
pub mod parallel;
pub mod peak;
pub mod permute;
mod pool;
pub mod random;
mod real;
pub mod reduce;
pub mod resample;
pub mod rms_norm;
pub mod rope;
pub mod rows;
pub mod simd;
pub mod softmax;
pub mod subdivision;
mod target;

pub use dual::Dual;
pub use pool::{Buffer, Pool};
pub use real::Real;
pub use target::Target;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
