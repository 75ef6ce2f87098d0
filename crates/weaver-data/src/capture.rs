//! Captures: folders of photos with cameras, loaded at the size that the network expects.
//!
//! | the folder holds | cameras | points | held out |
//! |---|---|---|---|
//! | `transforms.json` | nerfstudio, instant-ngp | COLMAP's in `sparse/0`, else a PLY file | `test_filenames`, else every 8th |
//! | `transforms_train.json`, `transforms_test.json` | NeRF-synthetic | none | the test file's frames |
//! | `sparse/0`, `images/` | COLMAP | COLMAP | every 8th |
//! | `cameras.txt` or `<16 hex digits>.txt`, `images/` | RealEstate10K | none | every 8th |
//!
//! Photos are sorted by path. The largest centered crop of the network's aspect ratio is shrunk with a Lanczos
//! filter; intrinsics follow exactly.
//!
//! - **Distortion** is undone after shrinking ([`Undistortion`](weaver_geometry::Undistortion)): the photo keeps its size, and is taken as
//!   if with the shortest focal length that leaves no blank border. Intrinsics are those of the result.
//! - **EXIF orientation**: photos without cameras are turned upright. With a camera they are if only that gives them its size
//!   ([`PhotoFile::for_camera`](weaver_io::PhotoFile::for_camera)); else, as always if they are square, they stay as they are stored.
//! - **Points** of a PLY file are the one that a transforms.json names (`ply_file_path`), `sparse_pc.ply` or `points3D.ply` beside it, or
//!   `points3D.ply` in place of COLMAP's. Which photos see them is told by what is nearest there.

mod by_name;
mod crop;
mod masks;
mod nerf;
mod photo;
mod photo_cameras;
pub mod posed;
mod realestate;
mod sparse;
mod visible;

use crate::{Error, Scene, View};
pub use crop::Crop;
use photo::{Photo, Photos, straight, straight_camera};
pub use photo_cameras::{PhotoCameras, load_camera_files, load_cameras};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use visible::visible_points;
use weaver_geometry::Camera;
use weaver_io::{Image, PhotoFile};

/// Which views are kept from training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HoldOut {
    /// The views that the capture lists, else every eighth.
    #[default]
    Listed,
    /// Every n-th view in order of path, starting with the first; none if n is 0.
    Every(usize),
    /// No views.
    Nothing,
}

/// How to load a capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureOptions {
    /// Image width for the network, pixels.
    pub width: usize,
    /// Image height for the network, pixels.
    pub height: usize,
    /// For captures without points: the length, in the capture's units, that becomes 1 in training. The mean
    /// distance from a camera to what it sees is a good choice.
    pub scene_scale: Option<f64>,
    /// Which views are kept from training.
    pub hold_out: HoldOut,
}

impl Default for CaptureOptions {
    fn default() -> Self {
        Self { width: 64, height: 48, scene_scale: None, hold_out: HoldOut::Listed }
    }
}

/// Loads a capture, a folder or a transforms.json of any name, with views in order of their paths.
///
/// # Errors
/// If the folder is missing or of no known kind, a file is missing, truncated or malformed, a pose or intrinsics
/// are missing or not finite, or a photo's size is not its camera's. The message names the file, the entry, what
/// was expected and what was found. How many views a task needs is checked by [`Scene::check_training`] and
/// [`Scene::check_evaluation`].
pub fn load(path: impl AsRef<Path>, options: &CaptureOptions) -> Result<Scene, Error> {
    let path = path.as_ref();
    let capture = read_split_photos(path, options.hold_out)?;
    let loaded: Vec<Result<(View, Vec<u32>), Error>> =
        capture.photos.par_iter().map(|photo| load_photo(photo, &capture, options)).collect();
    let (views, visible) = loaded.into_iter().collect::<Result<Vec<_>, _>>()?.into_iter().unzip();
    let Photos { points, remarks, .. } = capture;
    Ok(Scene { name: name(folder(path)), views, points, visible, scale: options.scene_scale, remarks })
}

/// Loads photos without cameras, each cropped and shrunk as [`load`] does, in the order given.
///
/// # Errors
/// If there is no path or a file is missing or not an image.
pub fn load_images(paths: &[PathBuf], width: usize, height: usize) -> Result<Vec<Image>, Error> {
    if paths.is_empty() {
        return Err(Error::unexpected(Path::new("photos"), "paths", "at least one", "none"));
    }
    let read = |path: &PathBuf| -> Result<Image, Error> {
        let photo = PhotoFile::at(path)?;
        let (w, h) = photo.size();
        Ok(Crop::centered(w, h, width, height).read(&photo)?.to_image())
    };
    let images: Vec<Result<Image, Error>> = paths.par_iter().map(read).collect();
    images.into_iter().collect()
}

/// The folder of a capture that is a folder or a transforms.json.
fn folder(path: &Path) -> &Path {
    if path.is_file() { path.parent().unwrap_or(Path::new(".")) } else { path }
}

/// What a capture is called: its folder's name.
fn name(folder: &Path) -> String {
    folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy().into_owned()
}

/// The photos of a capture in order of their paths, each held out or not.
fn read_split_photos(path: &Path, hold_out: HoldOut) -> Result<Photos, Error> {
    let mut capture = if path.is_file() { nerf::read(path)? } else { read_photos(path)? };
    let photos = &mut capture.photos;
    if photos.is_empty() {
        return Err(Error::unexpected(path, "photos", "at least one", "none"));
    }
    photos.sort_by(|a, b| a.frame.path.cmp(&b.frame.path));
    if !(capture.split && hold_out == HoldOut::Listed) {
        let step = match hold_out {
            HoldOut::Listed => 8,
            HoldOut::Every(step) => step,
            HoldOut::Nothing => 0,
        };
        for (i, photo) in photos.iter_mut().enumerate() {
            photo.held_out = step > 0 && i % step == 0;
        }
    }
    Ok(capture)
}

fn read_photos(folder: &Path) -> Result<Photos, Error> {
    if !folder.is_dir() {
        return Err(Error::unexpected(folder, "capture", "a folder or a transforms.json", "nothing"));
    }
    if folder.join("transforms.json").exists() {
        nerf::read(&folder.join("transforms.json"))
    } else if folder.join("transforms_train.json").exists() {
        nerf::read_split(folder)
    } else if folder.join("sparse").exists() {
        sparse::read(folder)
    } else if let Some(cameras) = realestate::camera_file(folder)? {
        realestate::read(folder, &cameras)
    } else {
        Err(Error::unexpected(
            folder,
            "cameras",
            "transforms.json, transforms_train.json, sparse/0 or a RealEstate10K camera file",
            "none of them",
        ))
    }
}

/// Reads a photo and finds the points it sees.
fn load_photo(photo: &Photo, capture: &Photos, options: &CaptureOptions) -> Result<(View, Vec<u32>), Error> {
    let (image, camera) = read_cropped(photo, options.width, options.height)?;
    let (visible, depth) = visible_points(&camera, capture, photo);
    let view = View {
        name: photo.frame.name.clone(),
        image,
        camera,
        depth: (!capture.points.is_empty()).then_some(depth),
        time: photo.frame.time,
        number: photo.frame.number,
        extras: photo.frame.extras.clone(),
        held_out: photo.held_out,
    };
    Ok((view, visible))
}

/// Reads a photo, brings it to the network's size, and undoes its distortion.
fn read_cropped(photo: &Photo, width: usize, height: usize) -> Result<(Image, Camera), Error> {
    let file = photo.open()?;
    let Camera { pose, intrinsics, width: w, height: h } = photo.frame.camera;
    let crop = Crop::centered(w, h, width, height);
    let camera = Camera { pose, intrinsics: crop.intrinsics(&intrinsics), width, height };
    let lens = photo.lens(camera)?;
    let image = straight(crop.read(&file)?, lens.as_ref()).to_image();
    Ok((image, straight_camera(camera, lens.as_ref())))
}
