//! Captures of DTU, and of Tanks and Temples, in the layouts of MVSNet, and of IDR and NeuS.

use super::by_name;
use super::photo::{Photo, Photos};
use crate::Error;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_io::{PhotoFile, dtu};
use weaver_scene::Frame;

/// Archives of projections, whole scans first: all have the same `world_mat`.
const PROJECTIONS: [&str; 3] = ["cameras_sphere.npz", "cameras.npz", "cameras_large.npz"];
/// End of the names of camera files, behind the photo's name.
const CAM: &str = "_cam";

/// Cameras of one of the layouts.
#[derive(Debug)]
pub(super) enum Cameras {
    /// A folder of `NAME_cam.txt`.
    Folder(PathBuf),
    /// An archive of projections, in the order of the photos.
    Projections(PathBuf),
}

/// Finds the cameras that a folder has, if any.
pub(super) fn cameras(folder: &Path) -> Option<Cameras> {
    let projections = PROJECTIONS.iter().map(|name| folder.join(name)).find(|file| file.is_file());
    let cams = || ["cams", "Cameras"].iter().map(|name| folder.join(name)).find(|cams| cams.is_dir());
    projections.map(Cameras::Projections).or_else(|| cams().map(Cameras::Folder))
}

/// Photos in `images/` or `image/`, which the camera files are named after, or in the order of an archive; masks in
/// `mask/` by that order.
pub(super) fn read(folder: &Path, cameras: &Cameras) -> Result<Photos, Error> {
    let images = ["images", "image"].map(|name| folder.join(name)).into_iter().find(|images| images.is_dir());
    let images = images.ok_or_else(|| Error::unexpected(folder, "photos", "a folder images or image", "none"))?;
    let files = weaver_io::list_photos(&images)?;
    match cameras {
        Cameras::Folder(cams) => named(cams, &images, &files),
        Cameras::Projections(file) => ordered(file, folder, &files),
    }
}

fn named(cams: &Path, images: &Path, files: &[PathBuf]) -> Result<Photos, Error> {
    let stem = |path: &Path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let cameras = weaver_io::list_files(cams, &["txt"])?;
    let cameras: BTreeMap<String, PathBuf> =
        cameras.into_iter().filter_map(|path| Some((stem(&path).strip_suffix(CAM)?.to_string(), path))).collect();
    let (mut capture, mut unused) = (Photos::default(), Vec::new());
    for file in files {
        match cameras.get(&stem(file)) {
            Some(camera) => capture.photos.push(photo(file, dtu::read_cam(camera)?, None)),
            None => unused.push(file.display()),
        }
    }
    if capture.photos.is_empty() {
        let expected = format!("the photos in {}, as in 00000000{CAM}.txt of 00000000.jpg", images.display());
        let found = by_name::list(cameras.keys());
        return Err(Error::unexpected(
            cams,
            "names of cameras",
            expected,
            if found.is_empty() { "none".into() } else { found },
        ));
    }
    if !unused.is_empty() {
        let unused = by_name::list(unused.iter());
        capture.remarks.push(format!("{}: photos without a camera are not used: {unused}", cams.display()));
    }
    Ok(capture)
}

fn ordered(file: &Path, folder: &Path, files: &[PathBuf]) -> Result<Photos, Error> {
    let cameras = dtu::read_projections(file)?;
    if cameras.len() < files.len() {
        let expected = format!("a world_mat for each of {} photos", files.len());
        return Err(Error::unexpected(file, "projections", expected, cameras.len().to_string()));
    }
    let masks = folder.join("mask");
    let masks = if masks.is_dir() { weaver_io::list_photos(&masks)? } else { Vec::new() };
    if !masks.is_empty() && masks.len() != files.len() {
        let expected = format!("none, or one for each of {} photos", files.len());
        return Err(Error::unexpected(&folder.join("mask"), "masks", expected, masks.len().to_string()));
    }
    let photos = files.iter().zip(cameras).enumerate();
    let photos = photos.map(|(i, (file, camera))| photo(file, camera, masks.get(i).cloned())).collect();
    Ok(Photos { photos, ..Photos::default() })
}

/// A photo of the size of its file: these layouts say none.
fn photo(file: &Path, (intrinsics, pose): (Intrinsics, Pose), mask: Option<PathBuf>) -> Photo {
    let (width, height) = PhotoFile::at(file).map_or((1, 1), |photo| photo.stored_size());
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let frame = Frame::new(name, Camera { pose, intrinsics, width, height });
    Photo { frame: Frame { path: file.into(), mask, ..frame }, held_out: false, track: Vec::new() }
}
