//! The cameras of some photos, out of a file with the cameras of many.

use super::photo::Photo;
use super::photo::Photos;
use super::{MaskedImage, by_name, masks, nerf, project, read_cropped, sparse, visible_points};
use crate::{Error, SparsePoints};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use weaver_geometry::Camera;
use weaver_geometry::lens::LensCamera;
use weaver_io::colmap::{Model, model_folder};
use weaver_io::{Image, ProjectKind};
use weaver_scene::Frame;

/// Photos with their cameras and the points that they show, in the frame of the first camera and in units of their own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotoCameras {
    /// The photos, without distortion.
    pub images: Vec<Image>,
    /// Mask of each photo's pixels that count, `[height, width]`; `None` for a photo that has no mask, or one that
    /// leaves nothing out.
    pub inside: Vec<Option<Vec<bool>>>,
    /// One for each photo, with intrinsics for it.
    pub cameras: Vec<Camera>,
    /// The points that at least one photo shows; empty where the file has none.
    pub points: SparsePoints,
}

/// Reads photos with their cameras, cropped, shrunk to `width` x `height` and without distortion as
/// [`load`](super::load) does.
///
/// `file` is a transforms.json, with the points of a COLMAP model in `sparse/0` or `sparse` beside it where there is
/// one; a folder with a COLMAP model, itself or in `sparse/0` or `sparse`; the file of another program's
/// [`Project`](weaver_io::Project); or a RealEstate10K file. A photo's camera is the one whose name has most parts in
/// common with the end of the photo's path: `a/1.jpg` and `b/1.jpg` differ, and `1.jpg` is enough where it is the only
/// one. With `masked`, photos are white outside of their masks: those that the file names, else as
/// [`load_masked_images`](super::load_masked_images) finds them.
///
/// # Errors
/// When the file is missing or malformed; when photos have no camera, several, or one that another photo has, too: all
/// of them are listed; when a photo cannot be read, its size is not its camera's, or a requested mask is missing.
pub fn load_cameras(
    file: &Path,
    photos: &[PathBuf],
    [width, height]: [usize; 2],
    masked: bool,
) -> Result<PhotoCameras, Error> {
    let capture = read(file)?;
    let found = of_photos(capture.photos.clone(), file, photos)?;
    let masks = masked.then(|| masks::of_known(&found, file)).transpose()?;
    let load = |(i, photo): (usize, &Photo)| {
        let (image, camera) = read_cropped(photo, masks.as_ref().map(|masks| &masks[i]), width, height)?;
        Ok((image, (camera, visible_points(&LensCamera::new(camera, None), &capture, photo).0)))
    };
    let loaded: Vec<Result<_, Error>> = found.par_iter().enumerate().map(load).collect();
    let loaded: Vec<_> = loaded.into_iter().collect::<Result<_, Error>>()?;
    let (images, seen): (Vec<MaskedImage>, Vec<_>) = loaded.into_iter().unzip();
    let (images, inside) = images.into_iter().unzip();
    let (mut cameras, visible): (Vec<Camera>, Vec<_>) = seen.into_iter().unzip();
    let Some(Camera { pose: first, .. }) = cameras.first().copied() else { return Ok(PhotoCameras::default()) };
    let visible: Vec<&[u32]> = visible.iter().map(Vec::as_slice).collect();
    let points = SparsePoints::seen_from(&first, 1.0, &capture.points, &visible);
    cameras.iter_mut().for_each(|camera| camera.pose = camera.pose.relative_to(&first));
    Ok(PhotoCameras { images, inside, cameras, points })
}

/// The cameras of photos as they are on disk, distortion aside, matched by name as [`load_cameras`] does, in the world
/// of the file.
///
/// # Errors
/// As [`load_cameras`].
pub fn load_camera_files(file: &Path, photos: &[PathBuf]) -> Result<Vec<Camera>, Error> {
    Ok(frames(file, photos)?.into_iter().map(|frame| frame.camera).collect())
}

/// The frames of photos, matched by name, with the photos as their paths.
pub(super) fn frames(file: &Path, photos: &[PathBuf]) -> Result<Vec<Frame>, Error> {
    Ok(of_photos(read(file)?.photos, file, photos)?.into_iter().map(|photo| photo.frame).collect())
}

/// The requested photos among all in a file, with the paths that they have here.
fn of_photos(known: Vec<Photo>, file: &Path, photos: &[PathBuf]) -> Result<Vec<Photo>, Error> {
    let names: Vec<&str> = known.iter().map(|photo| photo.frame.name.as_str()).collect();
    let files: Vec<&Path> = known.iter().map(|photo| photo.frame.path.as_path()).collect();
    let named = |(path, at): (&PathBuf, usize)| {
        let found = known[at].clone();
        Photo { frame: Frame { path: path.clone(), ..found.frame }, ..found }
    };
    Ok(photos.iter().zip(by_name::cameras(file, &names, &files, photos)?).map(named).collect())
}

fn read(file: &Path) -> Result<Photos, Error> {
    if file.is_dir() {
        return Ok(sparse::photos(&Model::read(model_folder(file))?, &[]));
    }
    if ProjectKind::of(file)?.is_some() {
        return project::read_cameras(file);
    }
    if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("txt")) {
        let frames = weaver_io::read_cameras(file)?;
        return Ok(Photos::without_points(frames));
    }
    nerf::read_cameras(file)
}
