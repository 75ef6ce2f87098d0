//! Pose codes, cameras, rotations and unprojection, against references and finite differences.

mod cameras;
mod code;
mod descent;
// Networks read weights with it, too; it needs these three crates.
#[allow(dead_code)]
#[path = "../../../../models/vggt/tests/it/fixture.rs"]
mod fixture;
mod gauge;
mod metrics;
mod plane_sweep;
mod rotation;
mod unproject;

use safetensors as _;
use serde_json as _;
