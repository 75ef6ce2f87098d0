//! Pose codes, cameras, unprojection and the camera head, against references and finite differences.

mod code;
mod fixture;
mod gauge;
mod head;
mod metrics;
mod rotation;
mod unproject;
