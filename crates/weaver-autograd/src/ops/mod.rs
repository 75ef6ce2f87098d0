//! The built-in ops, one per file; most are methods of [`Var`](crate::Var).

pub mod pointwise_ops;
mod sum;
