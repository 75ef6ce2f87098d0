//! File formats: images, Gaussians (PLY, compressed PLY, splat, SPZ, SOG, glTF, USD, ksplat), COLMAP, transforms.json,
//! RealEstate10K, LLFF, Nerfies, cameras of Metashape, RealityScan, Bundler and OpenSfM, safetensors, NPY; scans of
//! lidars (KITTI .bin, PLY, PCD, NPY) and trajectories (KITTI, TUM); surfaces (PLY, glTF, OBJ).
//!
//! [`read_gaussians`] and [`read_cameras`] read every supported format of scenes and of cameras into the types of
//! `weaver-scene`. Poses are world-to-camera with OpenCV axes, intrinsics are in pixels with pixel centers at
//! half-integers. Every failure is an [`Error`] that names the file and the place in it; malformed files never cause a
//! panic. Files are written atomically ([`atomic_write`]).

mod advice;
mod cameras;
mod error;
mod files;
mod gaussians;
mod info;
mod lidar;
mod observe;
mod pictures;
mod places;
mod surfaces;
mod tensors;

pub use advice::Advice;
pub use cameras::convert::{ConvertedCameras, convert_cameras, is_cameras};
pub use cameras::project::{Project, ProjectKind};
pub use cameras::read_cameras;
pub use cameras::transforms::Transforms;
pub use cameras::{colmap, dtu, llff, nerfies, realestate};
pub use error::{Error, Result};
pub use files::append::Appender;
pub use files::atomic::atomic_write;
pub use files::checksum::Checksum;
pub use files::file::{file_length, read_bytes, read_part, read_text, write_text};
pub use files::folder::{
    check_writable, create_folder, is_taken, list_files, list_folders, path_in_utf8, relative_path,
};
pub use files::inputs::input_checksum;
pub use files::memory::{TooLittleMemory, available_memory, check_memory, peak_mb};
pub use files::natural_order::natural_order;
pub use files::output_folder::{OutputFolder, check_output_file, check_output_folder};
pub use files::scratch_file::ScratchFile;
pub use files::shell::ShellCommand;
pub use files::staged::Staged;
pub use files::unfinished::{UnfinishedFile, remove_unfinished};
pub use files::written::written;
pub use gaussians::ply;
pub use gaussians::{
    Blocks, Chained, Changed, Conversion, ConvertError, Converted, Drawing, Keep, Loss, OpenScene, SCENE_FORMATS,
    SceneFile, SceneFormat, Score, ScoreOf, WrittenScene, convert, open_scene, read_gaussians, read_gaussians_from,
    read_scene, scene_bytes, spz_step, write_blocks, write_blocks_checked, write_gaussians, write_gaussians_to,
    write_scene,
};
pub use info::info;
pub use lidar::poses::{TrajectoryFile, TrajectoryFormat};
pub use lidar::scan::{LIDAR_FORMATS, LidarScan, read_lidar_scan, write_lidar_scan};
pub use observe::{Observe, Part, Stage, duration};
pub use pictures::bitmap::Bitmap;
pub use pictures::color::{false_color, label_color};
pub use pictures::depth::DepthPicture;
pub use pictures::exif::focal_35mm;
pub use pictures::heif::{HeifPhoto, Turned};
pub use pictures::image::{Background, Image};
pub use pictures::panorama::{Panorama, jpeg_of_panorama};
pub use pictures::photo_file::{PhotoFile, list_photos, photos_at};
pub use pictures::photo_folder::PhotoFolder;
pub use pictures::place::{PhotoPlace, photo_place};
pub use places::{BarInPhoto, Positions, read_positions, read_scale_bar};
pub use surfaces::{SURFACE_FORMATS, Surface, SurfaceTexture};
pub use tensors::array::open_array;
pub use tensors::npy::{Npy, write_npy};
pub use tensors::npz::Npz;
pub use tensors::safetensors;
pub use tensors::torch::TorchCheckpoint;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
