//! Captures: folders of photos with cameras, loaded at the size that the network expects.
//!
//! | the folder holds | cameras | points | held out |
//! |---|---|---|---|
//! | `transforms.json` | nerfstudio, instant-ngp | COLMAP's in `sparse/0`, if there | `test_filenames`, else every 8th |
//! | `transforms_train.json`, `transforms_test.json` | NeRF-synthetic | none | the test file's frames |
//! | `sparse/0`, `images/` | COLMAP | COLMAP | every 8th |
//! | `cameras.txt` or `<16 hex digits>.txt`, `images/` | RealEstate10K | none | every 8th |
//!
//! Photos are sorted by path. The largest centered crop of the network's aspect ratio is shrunk with a Lanczos
//! filter; intrinsics follow exactly.

mod by_name;
mod crop;
mod nerf;
mod photo;
mod photo_cameras;
pub mod posed;
mod realestate;
mod sparse;

use crate::{Error, Scene, View};
pub use crop::Crop;
use photo::{Photo, Photos};
pub use photo_cameras::{PhotoCameras, load_camera_files, load_cameras};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics};
use weaver_io::{Background, Image};
use weaver_scene::Frame;

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
    let Photos { photos, points, .. } = read_split_photos(path, options.hold_out)?;
    let loaded: Vec<Result<(View, Vec<u32>), Error>> =
        photos.par_iter().map(|photo| load_photo(photo, &points, options)).collect();
    let (views, visible) = loaded.into_iter().collect::<Result<Vec<_>, _>>()?.into_iter().unzip();
    Ok(Scene { name: name(folder(path)), views, points, visible, scale: options.scene_scale })
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
        let image = Image::read(path, Background::White)?;
        Ok(Crop::centered(image.width, image.height, width, height).apply(&image))
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

/// Reads a photo, brings it to the network's size, and finds the points it sees.
fn load_photo(photo: &Photo, points: &[DVec3], options: &CaptureOptions) -> Result<(View, Vec<u32>), Error> {
    let (width, height) = (options.width, options.height);
    let frame = &photo.frame;
    check_camera(frame)?;
    let image = Image::read(&frame.path, Background::White)?;
    check_size(&frame.path, (image.width, image.height), &frame.camera)?;
    let crop = Crop::centered(image.width, image.height, width, height);
    let camera =
        Camera { pose: frame.camera.pose, intrinsics: crop.intrinsics(&frame.camera.intrinsics), width, height };
    let (visible, depth) = visible_points(&camera, points, &photo.track);
    let view = View {
        name: frame.name.clone(),
        image: crop.apply(&image),
        camera,
        depth: (!points.is_empty()).then_some(depth),
        time: frame.time,
        number: frame.number,
        held_out: photo.held_out,
    };
    Ok((view, visible))
}

fn check_size(path: &Path, (width, height): (usize, usize), camera: &Camera) -> Result<(), Error> {
    if (width, height) == (camera.width, camera.height) {
        return Ok(());
    }
    let expected = format!("{}x{}, its camera's", camera.width, camera.height);
    Err(Error::unexpected(path, "image size", expected, format!("{width}x{height}")))
}

fn check_camera(frame: &Frame) -> Result<(), Error> {
    let Camera { pose, intrinsics: Intrinsics { fx, fy, cx, cy }, .. } = frame.camera;
    if !(pose.rotation.is_finite() && pose.translation.is_finite()) {
        return Err(Error::unexpected(&frame.path, "pose", "finite numbers", format!("{pose:?}")));
    }
    let valid = fx > 0.0 && fy > 0.0 && [fx, fy, cx, cy].iter().all(|x| x.is_finite());
    if !valid {
        let found = format!("fx {fx} fy {fy} cx {cx} cy {cy}");
        return Err(Error::unexpected(&frame.path, "intrinsics", "finite numbers, focal lengths above 0", found));
    }
    Ok(())
}

/// Which tracked points lie inside the image and in front of the camera, and a depth map of them with the nearest point of
/// each pixel.
fn visible_points(camera: &Camera, points: &[DVec3], track: &[u32]) -> (Vec<u32>, Vec<f32>) {
    let mut visible = Vec::with_capacity(track.len());
    let mut depth = vec![0.0_f32; camera.width * camera.height];
    for &index in track {
        let local = camera.pose.apply(points[index as usize]);
        let pixel = camera.intrinsics.project(local).floor();
        let inside =
            pixel.x >= 0.0 && pixel.x < camera.width as f64 && pixel.y >= 0.0 && pixel.y < camera.height as f64;
        if local.z > 0.0 && inside {
            visible.push(index);
            let cell = &mut depth[pixel.y as usize * camera.width + pixel.x as usize];
            let z = local.z as f32;
            if *cell == 0.0 || z < *cell {
                *cell = z;
            }
        }
    }
    (visible, depth)
}
