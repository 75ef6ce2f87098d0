//! Layers, optimiser, schedules and weight averaging on the `weaver-autograd` tape.
//!
//! A layer is a struct of [`ParamId`](weaver_autograd::ParamId)s: it is built with a [`Builder`] and run with a [`Context`].

mod attention;
mod block;
mod builder;
mod context;
mod conv;
mod layer_norm;
mod linear;
mod mlp;

pub use attention::Attention;
pub use block::{Block, BlockConfig};
pub use builder::{Builder, Init, WeightInit};
pub use context::Context;
pub use conv::{Conv2d, ConvTranspose2d};
pub use layer_norm::LayerNorm;
pub use linear::Linear;
pub use mlp::Mlp;
