//! Integration tests: round trips, real files, hostile bytes.

mod array;
mod atomic;
mod cameras;
mod colmap;
mod exif;
mod files;
mod formats;
mod images;
mod info;
mod llff;
mod mapped;
mod mutated;
mod mutations;
mod nerfies;
mod output_folder;
mod owned;
mod photo_file;
mod photo_memory;
mod pillow;
mod ply;
mod realestate;
mod shared;
mod shrunk;
mod spz;
mod torch;
mod transforms;
