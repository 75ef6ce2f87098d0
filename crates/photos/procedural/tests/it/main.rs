//! Integration tests of weaver-procedural.

mod appearance;
mod film;
mod lidar;
mod procedural;
#[path = "../../../data/tests/it/quality.rs"]
mod quality;
mod varied;
