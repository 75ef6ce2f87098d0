//! Layers, optimiser, schedules and weight averaging on the `weaver-autograd` tape.
//!
//! A layer is a struct of [`ParamId`](weaver_autograd::ParamId)s: it is built with a [`Builder`] and run with a [`Context`].

mod builder;
mod context;

pub use builder::{Builder, Init};
pub use context::Context;
