//! File formats: images, Gaussians (PLY, compressed PLY, splat, SPZ), COLMAP, transforms.json, RealEstate10K, LLFF, Nerfies, safetensors,
//! NPY.
//!
//! [`read_gaussians`] and [`read_cameras`] read every supported format of scenes and of cameras into the types of
//! `weaver-scene`. Poses are world-to-camera with OpenCV axes, intrinsics are in pixels with pixel centers at half-integers.
//! Every failure is an [`Error`] that names the file and the place in it; malformed files never cause a panic. Files are
//! written atomically ([`atomic_write`]).

mod append;
mod array;
mod atomic;
mod bitmap;
mod bytes;
mod cameras;
pub mod checkpoint;
mod checksum;
pub mod colmap;
mod color;
mod error;
mod exif;
mod file;
mod folder;
mod gaussian_fields;
mod gaussians;
mod header_fault;
mod image;
mod info;
mod json;
pub mod llff;
mod mapped_file;
mod memory;
pub mod nerfies;
mod npy;
mod output_folder;
mod photo_file;
pub mod ply;
pub mod realestate;
mod resize;
mod splat;
mod spz;
mod tensor_file;
mod torch;
mod transforms;
mod weights;
mod weights_writer;

pub use append::Appender;
pub use array::open_array;
pub use atomic::atomic_write;
pub use bitmap::Bitmap;
pub use cameras::read_cameras;
pub use checksum::Checksum;
pub use color::{false_color, label_color};
pub use error::{Error, Result};
pub use exif::focal_35mm;
pub use file::{file_length, read_bytes, read_text, write_text};
pub use folder::{check_writable, create_folder, list_files, list_folders, path_in_utf8, relative_path};
pub use gaussians::{
    SCENE_FORMATS, SceneFormat, read_gaussians, read_gaussians_from, write_gaussians, write_gaussians_to,
};
pub use image::{Background, Image};
pub use info::info;
pub use memory::{available_memory, peak_mb};
pub use npy::{Npy, write_npy};
pub use output_folder::{OutputFolder, check_output_file};
pub use photo_file::{PhotoFile, list_photos};
pub use tensor_file::TensorFile;
pub use torch::TorchCheckpoint;
pub use transforms::Transforms;
pub use weights::{Slice, Storage, Weight, Weights};
pub use weights_writer::{Planned, write_weights};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
