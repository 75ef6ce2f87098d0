//! The built-in ops, one per file; most are methods of [`Var`](crate::Var).

pub mod activations;
mod blocks;
mod concat;
mod expand;
mod gather_rows;
mod layer_norm;
mod linear;
mod matmul;
mod permute;
pub mod pointwise_ops;
mod rows;
mod scatter_add_rows;
mod slice;
mod softmax;
mod strided;
mod sum;
mod sum_axis;

pub use concat::concat;
pub use linear::{Activation, linear};
pub use slice::split;
