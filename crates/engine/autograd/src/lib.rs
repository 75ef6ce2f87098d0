#![doc = include_str!("../README.md")]

pub mod gradcheck;
// Unit tests, which nothing is linked to, do without.
#[cfg(not(test))]
mod instances;
mod op;
pub mod ops;
mod params;
mod pointwise;
mod profile;
mod recycle;
mod shape;
mod tape;
mod var;

pub use op::{Backward, Grad, Op, View, ViewMut};
pub use ops::pointwise_ops::apply_pointwise;
pub use params::{HalfValues, Param, ParamId, ParamValues, Params};
pub use pointwise::{Pointwise, PointwiseOp};
pub use profile::{OpMemory, OpTime, Phase, TraceEvent};
pub use shape::{MAX_OUTPUTS, MAX_RANK, Shape, ShapeError, Shapes};
pub use tape::{List, NodeView, Outputs, Steps, Tape};
pub use var::Var;
pub use weaver_kernels::{Buffer, Dual, Pool, Real};
