//! Integration tests: round trips, real files, hostile bytes.

mod colmap;
mod images;
mod realestate;
mod shared;
mod transforms;
