//! Pose codes, cameras, rotations and unprojection, against references and finite differences.

mod cameras;
mod code;
mod descent;
mod gauge;
mod metrics;
mod plane_sweep;
mod rotation;
mod unproject;
