//! The methods on small scenes: bytes, quality, operations on the tape, surfaces.

mod methods;
mod ops;
#[path = "../../../../crates/fit/compress/tests/it/scenes.rs"]
mod scenes;
mod schedule;
mod surfaces;
