//! The rasterizer of `weaver-splat`, forward and backward, on any GPU: WGSL compute shaders run through wgpu.
//!
//! - [`adapters`] lists the adapters to run on; [`Context`] opens one and compiles the shaders.
//! - [`GpuRasterizer`] implements [`weaver_splat::Rasterizer`]: slices in, slices out, the rules and formulas of the
//!   CPU's.
//! - [`GpuRasterizer::encode`] records a drawing into commands of one's own, of buffers that are on the device already.
//! - [`SHADERS`] are the passes, as text that other programs may run too.
//! - [`sort_pairs`] is the sort by itself.
//!
//! Results are within 1e-4 of the CPU's and the same bits from run to run on one adapter: no number is added by whoever
//! comes first. docs/explain/gpu.md of the repository describes the passes and their costs.

mod adapter;
mod backward;
mod context;
mod encode;
mod error;
mod fit;
mod forward;
mod loss;
mod passes;
mod profile;
mod rasterizer;
mod room;
mod shader;
mod sort;
mod staging;
mod uniforms;
mod workspace;

pub use adapter::{Adapter, Choice, Kind, adapters};
pub use context::Context;
pub use encode::{DeviceGaussians, Recorded};
pub use error::GpuError;
pub use profile::PassTime;
pub use rasterizer::{GpuRasterizer, GpuSession};
pub use shader::{File, Kernel, SHADERS, Shader};
pub use sort::sort_pairs;
pub use staging::Transfers;
pub use wgpu;
pub use workspace::{GpuWorkspace, Lists};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
