//! Integration tests: round trips, real files, hostile bytes.

mod array;
mod atomic;
mod cameras;
mod checkpoint;
mod colmap;
mod exif;
mod files;
mod formats;
mod images;
mod info;
mod llff;
mod mutated;
mod mutations;
mod nerfies;
mod photo_file;
mod photo_memory;
mod pillow;
mod ply;
mod realestate;
mod shared;
mod shrunk;
mod spz;
mod tensor_file;
mod torch;
mod transforms;
mod weights;
