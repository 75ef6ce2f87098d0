//! Layers, the optimizers AdamW and RAdam, learning-rate schedules and weight averaging on the `weaver-autograd` tape.
//!
//! A layer is a small struct of [`ParamId`](weaver_autograd::ParamId)s: it is built with a [`Builder`] and run with a
//! [`Context`].

mod adamw;
mod attention;
mod block;
mod builder;
mod context;
mod conv;
mod dropout;
mod ema;
mod gradients;
mod layer_norm;
mod linear;
mod mlp;
mod optimizer;
mod positions;
mod projective;
mod radam;
mod rms_norm;
mod schedule;
mod view_block;

pub use adamw::{AdamW, Group, Moments, StateError};
pub use attention::Attention;
pub use block::{Block, BlockConfig};
pub use builder::{Builder, Init, WeightInit};
pub use context::Context;
pub use conv::{Conv1d, Conv2d, ConvTranspose2d};
pub use dropout::Dropout;
pub use ema::Ema;
pub use gradients::{add_l2_gradient, clip_factor, clip_global_norm, global_norm, missing_gradients};
pub use layer_norm::LayerNorm;
pub use linear::Linear;
pub use mlp::Mlp;
pub use optimizer::Optimizer;
pub use positions::Positions;
pub use projective::{Projections, projective_attention, turned_attention};
pub use radam::RAdam;
pub use rms_norm::RmsNorm;
pub use schedule::{PublishedSchedule, WarmupCosine};
pub use view_block::{Known, ViewBlock};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
