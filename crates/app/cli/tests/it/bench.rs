//! `splatweaver bench`.

mod bad_workloads;
mod compress;
mod engine;
mod raster;
mod surfels;
