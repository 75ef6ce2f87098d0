//! A reverse-mode tape of [`Op`] values over pooled buffers, generic over `f32` and `f64`.
//!
//! An op is a value that owns its saved state; the tape owns all memory; kernels are plain functions on slices.
//! What makes it different: gradients know whether they are written for the first time, a missing gradient is an
//! error and never a silent zero, a repeated step allocates nothing, and the bits do not depend on the number of
//! threads.
#![doc = include_str!("../../../docs/add-an-op.md")]

mod dual;
pub mod gradcheck;
mod op;
pub mod ops;
mod params;
mod pointwise;
mod pool;
mod profile;
mod recycle;
mod shape;
mod tape;
mod var;

pub use dual::Dual;
pub use op::{Grad, Op, View, ViewMut};
pub use ops::pointwise_ops::apply_pointwise;
pub use params::{Param, ParamId, Params};
pub use pointwise::{Pointwise, PointwiseOp};
pub use pool::{Buffer, Pool};
pub use profile::OpTime;
pub use shape::{MAX_OUTPUTS, MAX_RANK, Shape, ShapeError, Shapes};
pub use tape::{List, Scope, Tape};
pub use var::Var;
pub use weaver_kernels::Real;
