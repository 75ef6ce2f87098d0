//! Where Gaussians are drawn: `--device`.

#[cfg(feature = "gpu")]
mod gpu;
#[cfg(not(feature = "gpu"))]
#[path = "device/no_gpu.rs"]
mod gpu;

pub use gpu::{Device, list};

use crate::failure::Failure;
use crate::flags::DeviceFlag;
use std::sync::Arc;
use weaver_fit::FitRasterizer;
use weaver_splat::CpuRasterizer;

/// The rasterizer selected by the flag.
pub fn rasterizer(flag: &DeviceFlag) -> Result<Arc<dyn FitRasterizer>, Failure> {
    Ok(match name(flag) {
        Some(name) => Device::open(name)?.into_rasterizer(),
        None => Arc::new(CpuRasterizer),
    })
}

/// The device selected by the flag; `None` is the processor.
pub fn name(flag: &DeviceFlag) -> Option<&str> {
    flag.device.as_deref().filter(|device| *device != "cpu")
}
