//! Tests of the rasterizer on a device: an adapter of any kind, software ones included. Without one they are skipped.

mod backward;
mod bits;
mod device;
mod encode;
mod fixtures;
mod forward;
mod hostile;
mod mutations;
mod records;
mod resident;
#[path = "../../../../scene/splat/tests/it/scene.rs"]
#[allow(dead_code, reason = "the scenes of the CPU's tests, which need more of them")]
mod scene;
mod shaders;
mod sorting;
mod uniformity;
