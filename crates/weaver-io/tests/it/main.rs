//! Integration tests: round trips, real files, hostile bytes.

mod atomic;
mod checkpoint;
mod colmap;
mod files;
mod images;
mod info;
mod ply;
mod realestate;
mod shared;
mod spz;
mod tensor_file;
mod torch;
mod transforms;
mod weights;
