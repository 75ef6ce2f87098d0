//! `splatweaver bench`.

mod bad_workloads;
mod engine;
mod raster;
mod surfels;
