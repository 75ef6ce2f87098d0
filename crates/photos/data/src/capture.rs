//! Captures: folders of photos with cameras, loaded at the size that the network expects.
//!
//! | the folder holds | cameras | points | held out |
//! |---|---|---|---|
//! | `transforms.json` | nerfstudio, instant-ngp | COLMAP's in `sparse/0`, else a PLY file | `test_filenames`, none if that is empty; every 8th if it is missing |
//! | `transforms_train.json`, `transforms_test.json` | NeRF-synthetic | none | the test file's frames |
//! | `sparse/0`, `images/` | COLMAP | COLMAP | every 8th |
//! | `cameras.txt` or `<16 hex digits>.txt`, `images/` | RealEstate10K | none | every 8th |
//! | `cams/` or `Cameras/` of `NAME_cam.txt`, `images/` | DTU, Tanks and Temples, as for MVSNet | none | every 8th |
//! | `*.xml`, `*.csv`, `*.out`, `reconstruction.json` | Metashape, RealityScan, Bundler, OpenSfM ([`Project`]) | Bundler, OpenSfM | every 8th |
//! | `cameras_sphere.npz` or `cameras.npz`, `image/`, `mask/` | DTU as for IDR and NeuS | none | every 8th |
//!
//! Photos are sorted by path. The largest centered crop of the network's aspect ratio is shrunk with a Lanczos
//! filter; intrinsics follow exactly.
//!
//! - **Distortion** is undone at up to three times the final size ([`Undistortion`](weaver_geometry::Undistortion)):
//!   the photo keeps its size, and is taken as if with the shortest focal length that leaves no blank border.
//!   Intrinsics belong to the result.
//! - **EXIF orientation**: photos without cameras are turned upright. A photo with a camera is turned if that alone
//!   gives it the camera's size ([`PhotoFile::for_camera`](weaver_io::PhotoFile::for_camera)); else, and always if it
//!   is square, it stays as it is stored.
//! - **Points** of a PLY file are the one that a transforms.json names (`ply_file_path`), `sparse_pc.ply` or
//!   `points3D.ply` beside it, or `points3D.ply` in place of COLMAP's. A photo sees the points that are nearest there.

mod by_name;
mod crop;
mod dtu;
mod lenses;
mod masks;
mod nerf;
mod photo;
mod photo_cameras;
mod photo_masks;
pub mod posed;
mod project;
mod realestate;
mod sparse;
mod survey;
mod visible;

use crate::unreadable::{Fault, Needed, without_unreadable};
use crate::{Error, Scene, View};
pub use crop::Crop;
pub(crate) use masks::Mask;
use photo::{Photo, Photos, straight, straight_camera};
pub use photo_cameras::{PhotoCameras, load_camera_files, load_cameras};
pub(crate) use photo_masks::MASKS;
pub use photo_masks::{MaskOptions, PhotoMasks};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::str::FromStr;
pub use survey::{Survey, SurveyedPhoto, survey};
use visible::visible_points;
use weaver_geometry::Camera;
use weaver_geometry::lens::LensCamera;
use weaver_io::{Image, PhotoFile, Project, ProjectKind, is_taken};

/// Choice of the views that are kept from training.
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

/// `listed`, `none`, or a number N from 2 for every N-th photo.
///
/// ```
/// use weaver_data::capture::HoldOut;
/// assert_eq!(["none", "8"].map(str::parse), [Ok(HoldOut::Nothing), Ok(HoldOut::Every(8))]);
/// ```
impl FromStr for HoldOut {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match (text, text.parse()) {
            ("listed", _) => Ok(Self::Listed),
            ("none", _) => Ok(Self::Nothing),
            (_, Ok(step)) if (2..=1000).contains(&step) => Ok(Self::Every(step)),
            _ => Err("expected listed, none or a number from 2 to 1000, as in 8".into()),
        }
    }
}

/// Options of loading a capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureOptions {
    /// Image width for the network, pixels.
    pub width: usize,
    /// Image height for the network, pixels.
    pub height: usize,
    /// For captures without points: the length, in the capture's units, that becomes 1 in training. The mean distance
    /// from a camera to its subject is a good choice.
    pub scene_scale: Option<f64>,
    /// The views that are kept from training.
    pub hold_out: HoldOut,
    /// True if photos have masks ([`PosedOptions::masks`](posed::PosedOptions::masks)); pixels outside are white and do
    /// not count.
    pub masks: bool,
}

impl Default for CaptureOptions {
    fn default() -> Self {
        Self { width: 64, height: 48, scene_scale: None, hold_out: HoldOut::Listed, masks: false }
    }
}

/// Loads a capture, with views in order of their paths: a folder, a transforms.json of any name, or the file of another
/// program's [`Project`].
///
/// # Errors
/// If the folder is missing or of no known kind, a file of cameras is missing, truncated or malformed, a pose or
/// intrinsics are missing or not finite, or a photo's size is not its camera's. The message names the file, the entry,
/// the expected and the found content. Photos that cannot be read are left out and named in [`Scene::remarks`]; it is
/// an error if these are too many ([`Error::Unreadable`]). How many views a task needs is checked by
/// [`Scene::check_training`] and [`Scene::check_evaluation`].
pub fn load(path: impl AsRef<Path>, options: &CaptureOptions) -> Result<Scene, Error> {
    let path = path.as_ref();
    let capture = read_split_photos(path, options.hold_out)?;
    let masks = options.masks.then(|| masks::of_capture(&capture.photos, folder(path))).transpose()?;
    let load = |(i, photo)| load_photo(photo, masks.as_ref().map(|masks| &masks[i]), &capture, options);
    let loaded: Vec<Result<(View, Vec<u32>), Fault>> = capture.photos.par_iter().enumerate().map(load).collect();
    let (paths, needed) = (capture.paths(), Needed { least: 1, all: loaded.len() });
    let (loaded, unreadable) = without_unreadable(paths, loaded, needed)?;
    let mut loaded: Vec<(View, Vec<u32>)> = loaded.into_iter().flatten().collect();
    let Photos { points, mut remarks, .. } = capture;
    remarks.extend(unreadable);
    let masked: Vec<&str> =
        loaded.iter().filter(|(view, _)| view.is_masked()).map(|(view, _)| view.name.as_str()).collect();
    if !masked.is_empty() {
        remarks.push(format!(
            "{}: photos that are masked altogether are not used: {}",
            path.display(),
            masked.join(", ")
        ));
    }
    loaded.retain(|(view, _)| !view.is_masked());
    let (views, visible) = loaded.into_iter().unzip();
    Ok(Scene { name: name(folder(path)), views, points, visible, scale: options.scene_scale, remarks })
}

/// Loads photos without cameras, each cropped and shrunk as [`load`] does, in the order given.
///
/// # Errors
/// If there is no path or a file is missing or not an image.
pub fn load_images(paths: &[PathBuf], width: usize, height: usize) -> Result<Vec<Image>, Error> {
    let read = |path: &PathBuf| -> Result<Image, Error> { Ok(uncut(path, None, width, height)?.0) };
    let images: Vec<Result<Image, Error>> = at_least_one(paths)?.par_iter().map(read).collect();
    images.into_iter().collect()
}

/// Loads photos as [`load_images`] does, each with the pixels that count by its mask: a file in a folder `masks` beside
/// it or beside its folder, named as [`PosedOptions::masks`](posed::PosedOptions::masks) says, or its alpha.
///
/// # Errors
/// As [`load_images`]; when a photo has no mask, or one of another size.
pub fn load_masked_images(paths: &[PathBuf], width: usize, height: usize) -> Result<Vec<MaskedImage>, Error> {
    let masks = masks::of_photos(at_least_one(paths)?)?;
    let read = |(path, mask): (&PathBuf, &Mask)| uncut(path, Some(mask), width, height);
    let images: Vec<Result<MaskedImage, Error>> = paths.par_iter().zip(&masks).map(read).collect();
    images.into_iter().collect()
}

/// Photos of a list in which some could not be read.
#[derive(Clone, Debug)]
pub struct ReadableImages {
    /// The readable ones.
    pub paths: Vec<PathBuf>,
    /// The pictures with their masks.
    pub images: Vec<MaskedImage>,
    /// A remark on the unreadable photos with the reasons, if any.
    pub remark: Option<String>,
}

/// Loads photos as [`load_images`] does, or with their masks as [`load_masked_images`] does, without those that cannot
/// be read.
///
/// # Errors
/// When these are too many ([`Error::Unreadable`]); for masks, as [`load_masked_images`].
pub fn load_readable_images(
    paths: &[PathBuf],
    masked: bool,
    width: usize,
    height: usize,
) -> Result<ReadableImages, Error> {
    let masks = masked.then(|| masks::of_photos(at_least_one(paths)?)).transpose()?;
    let read = |(i, path): (usize, &PathBuf)| -> Result<MaskedImage, Fault> {
        let photo = PhotoFile::at(path).map_err(Fault::unreadable)?;
        if let Some(masks) = &masks {
            return Ok(uncut(path, Some(&masks[i]), width, height)?);
        }
        let (w, h) = photo.size();
        let image = Crop::centered(w, h, width, height).read(&photo).map_err(Fault::unreadable)?;
        Ok((image.to_image(), None))
    };
    let loaded: Vec<_> = at_least_one(paths)?.par_iter().enumerate().map(read).collect();
    let needed = Needed { least: 1, all: paths.len() };
    let (loaded, remark) = without_unreadable(paths.iter().map(PathBuf::as_path), loaded, needed)?;
    let readable = paths.iter().zip(loaded).filter_map(|(path, image)| Some((path.clone(), image?)));
    let (paths, images) = readable.unzip();
    Ok(ReadableImages { paths, images, remark })
}

fn at_least_one(paths: &[PathBuf]) -> Result<&[PathBuf], Error> {
    if paths.is_empty() {
        return Err(Error::unexpected(Path::new("photos"), "paths", "at least one", "none"));
    }
    Ok(paths)
}

/// A photo known by its file alone.
fn uncut(path: &Path, mask: Option<&Mask>, width: usize, height: usize) -> Result<MaskedImage, Error> {
    let photo = PhotoFile::at(path)?;
    let (w, h) = photo.size();
    let crop = Crop::centered(w, h, width, height);
    Ok(masked(path, photo, mask, |file| Ok(crop.read(file)?.to_image()))?)
}

/// A photo, white where its mask is dark, and the mask of its pixels that count, `[height, width]`: `None` if all do.
pub type MaskedImage = (Image, Option<Vec<bool>>);

/// Reads a photo and its mask, if it has one, in the same way.
fn masked(
    path: &Path,
    photo: PhotoFile,
    mask: Option<&Mask>,
    read: impl Fn(&PhotoFile) -> Result<Image, weaver_io::Error>,
) -> Result<MaskedImage, Fault> {
    let Some(mask) = mask else { return Ok((read(&photo).map_err(Fault::unreadable)?, None)) };
    let in_file = mask.file.is_some();
    let mask = mask.open(path, photo.clone())?;
    let fault = if in_file { |error: weaver_io::Error| Fault::Other(error.into()) } else { Fault::unreadable };
    let inside = read(&mask).map_err(fault)?;
    // Masked before it is resized, so that no pixel inside is mixed with pixels outside.
    let mut image = read(&if in_file { photo.masked(mask) } else { photo }).map_err(Fault::unreadable)?;
    let inside = masks::cut(&mut image, &inside);
    Ok((image, inside))
}

/// The folder of a capture that is a folder or a transforms.json.
fn folder(path: &Path) -> &Path {
    if path.is_file() { path.parent().unwrap_or(Path::new(".")) } else { path }
}

/// Name of a capture: its folder's.
fn name(folder: &Path) -> String {
    folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy().into_owned()
}

/// The photos of a capture in order of their paths, each held out or not.
fn read_split_photos(path: &Path, hold_out: HoldOut) -> Result<Photos, Error> {
    let mut capture = if path.is_file() { read_file(path)? } else { read_photos(path)? };
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

/// True if a folder holds cameras of a kind that [`load`] reads, or is a file of them.
///
/// # Errors
/// When the folder is missing or cannot be read.
pub fn has_cameras(path: &Path) -> Result<bool, Error> {
    if path.is_file() {
        return Ok(true);
    }
    let known = ["transforms.json", "transforms_train.json", "sparse"];
    let known = known.iter().any(|name| is_taken(path.join(name))) || dtu::cameras(path).is_some();
    Ok(known || Project::find(path)?.is_some() || realestate::camera_file(path)?.is_some())
}

/// The photos of a file of cameras.
fn read_file(path: &Path) -> Result<Photos, Error> {
    if ProjectKind::of(path)?.is_some() { project::read(path) } else { nerf::read(path) }
}

fn read_photos(folder: &Path) -> Result<Photos, Error> {
    if !folder.is_dir() {
        return Err(Error::unexpected(folder, "capture", "a folder or a file of cameras", "nothing"));
    }
    // A link that leads nowhere is named by who reads it, and no other cameras are taken in its place.
    let has = |name: &str| is_taken(folder.join(name));
    if has("transforms.json") {
        nerf::read(&folder.join("transforms.json"))
    } else if has("transforms_train.json") {
        nerf::read_split(folder)
    } else if has("sparse") {
        sparse::read(folder)
    } else if let Some(cameras) = dtu::cameras(folder) {
        dtu::read(folder, &cameras)
    } else if let Some(file) = Project::find(folder)? {
        project::read(&file)
    } else if let Some(cameras) = realestate::camera_file(folder)? {
        realestate::read(folder, &cameras)
    } else {
        Err(Error::unexpected(
            folder,
            "cameras",
            "transforms.json, transforms_train.json, sparse/0, cams/, cameras.npz, a RealEstate10K camera file, or one of \
             Metashape, RealityScan, Bundler or OpenSfM",
            "none of them; `splatweaver cameras` estimates some, `train --teacher` takes those of published weights",
        ))
    }
}

/// Reads a photo and finds the points it sees.
fn load_photo(
    photo: &Photo,
    mask: Option<&Mask>,
    capture: &Photos,
    options: &CaptureOptions,
) -> Result<(View, Vec<u32>), Fault> {
    let ((image, inside), camera) = read_cropped(photo, mask, options.width, options.height)?;
    let (visible, mut depth) = visible_points(&LensCamera::new(camera, None), capture, photo);
    for (depth, inside) in depth.iter_mut().zip(inside.iter().flatten()) {
        *depth *= f32::from(*inside);
    }
    let view = View {
        name: photo.frame.name.clone(),
        image,
        camera,
        inside,
        depth: (!capture.points.is_empty()).then_some(depth),
        time: photo.frame.time,
        number: photo.frame.number,
        extras: photo.frame.extras.clone(),
        instances: None,
        held_out: photo.held_out,
    };
    Ok((view, visible))
}

/// Reads a photo, brings it to the network's size, and undoes its distortion.
fn read_cropped(
    photo: &Photo,
    mask: Option<&Mask>,
    width: usize,
    height: usize,
) -> Result<(MaskedImage, Camera), Fault> {
    let file = photo.open()?;
    let Camera { pose, intrinsics, width: w, height: h } = photo.frame.camera;
    let crop = Crop::centered(w, h, width, height);
    let camera = Camera { pose, intrinsics: crop.intrinsics(&intrinsics), width, height };
    let lens = photo.lens(camera)?;
    let read = |file: &PhotoFile| {
        Ok(straight(lens.as_ref(), crop.shrink(), |times| crop.enlarged(times).read(file))?.to_image())
    };
    Ok((masked(&photo.frame.path, file, mask, read)?, straight_camera(camera, lens.as_ref())))
}
