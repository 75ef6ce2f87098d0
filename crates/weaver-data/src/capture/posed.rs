//! Photos at their own size with their cameras: what fitting a scene, or judging one, needs of a capture.

use super::photo::Photos;
use super::{HoldOut, check_camera, check_size, folder, name, read_split_photos};
use crate::Error;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use weaver_geometry::Camera;
use weaver_io::Image;
use weaver_scene::{Frame, PointCloud};

/// How to load photos with their cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PosedOptions {
    /// Longest side after shrinking, pixels; photos that are no larger, and all if `None`, keep their size.
    pub long_side: Option<usize>,
    /// Which photos are held out.
    pub hold_out: HoldOut,
    /// Whether to read masks: `mask_path` of a frame, or the photo's name in `masks/` beside the camera file, with its own
    /// extension, `.png` in its place, or `.png` behind it. Black is masked.
    pub masks: bool,
    /// The color behind transparent pixels.
    pub background: [f32; 3],
}

impl Default for PosedOptions {
    fn default() -> Self {
        Self { long_side: None, hold_out: HoldOut::Listed, masks: false, background: [1.0; 3] }
    }
}

/// A photo and its camera.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedPhoto {
    /// What the capture calls it.
    pub name: String,
    /// The image file.
    pub path: PathBuf,
    /// Pose, and intrinsics for [`rgb`](Self::rgb).
    pub camera: Camera,
    /// The same camera, with intrinsics for the image file.
    pub file_camera: Camera,
    /// sRGB, `[height, width, 3]`.
    pub rgb: Vec<u8>,
    /// What of the photo counts, `[height, width]`: 0 where masked; `None` if all does.
    pub mask: Option<Vec<u8>>,
    /// Kept from training, for evaluation.
    pub held_out: bool,
}

/// The photos of a capture, and its points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PosedPhotos {
    /// The capture's name.
    pub name: String,
    /// The photos in order of their paths.
    pub photos: Vec<PosedPhoto>,
    /// Points on surfaces; empty if the capture has none.
    pub points: PointCloud,
}

/// Loads the photos of a capture, which is what [`capture::load`](super::load) takes.
///
/// # Errors
/// As [`capture::load`](super::load); also a mask that is missing or of another size than its photo.
pub fn load(path: impl AsRef<Path>, options: &PosedOptions) -> Result<PosedPhotos, Error> {
    let path = path.as_ref();
    let Photos { photos, points, colors, .. } = read_split_photos(path, options.hold_out)?;
    let folder = folder(path);
    let loaded: Vec<Result<PosedPhoto, Error>> =
        (photos.par_iter()).map(|photo| load_photo(&photo.frame, photo.held_out, folder, options)).collect();
    let canonical = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
    Ok(PosedPhotos {
        name: name(&canonical),
        photos: loaded.into_iter().collect::<Result<_, _>>()?,
        points: PointCloud { positions: points.iter().map(|p| p.as_vec3().to_array()).collect(), colors },
    })
}

/// The cameras that [`load`] would give the photos, and which of those are held out, without reading a photo.
///
/// # Errors
/// When the capture's camera files are missing or malformed.
pub fn cameras(path: impl AsRef<Path>, options: &PosedOptions) -> Result<Vec<(Camera, bool)>, Error> {
    let photos = read_split_photos(path.as_ref(), options.hold_out)?.photos;
    Ok(photos.iter().map(|photo| (resized(&photo.frame.camera, options.long_side), photo.held_out)).collect())
}

/// The camera of the photo shrunk to a longest side.
fn resized(camera: &Camera, long_side: Option<usize>) -> Camera {
    let longest = camera.width.max(camera.height);
    let Some(side) = long_side.filter(|side| *side < longest) else { return *camera };
    let shrunk = |length: usize| ((length * side) as f64 / longest as f64).round().max(1.0) as usize;
    let (width, height) = (shrunk(camera.width), shrunk(camera.height));
    let (sx, sy) = (width as f64 / camera.width as f64, height as f64 / camera.height as f64);
    Camera { intrinsics: camera.intrinsics.resized(sx, sy), width, height, ..*camera }
}

fn load_photo(frame: &Frame, held_out: bool, folder: &Path, options: &PosedOptions) -> Result<PosedPhoto, Error> {
    check_camera(frame)?;
    let (mut image, alpha) = Image::read_with_alpha(&frame.path)?;
    check_size(&frame.path, (image.width, image.height), &frame.camera)?;
    if let Some(alpha) = alpha {
        for (pixel, alpha) in image.pixels.chunks_exact_mut(3).zip(alpha) {
            (0..3).for_each(|c| pixel[c] += (1.0 - alpha) * options.background[c]);
        }
    }
    let camera = resized(&frame.camera, options.long_side);
    let mask = options.masks.then(|| mask(frame, folder, &camera)).transpose()?;
    let (name, path) = (frame.name.clone(), frame.path.clone());
    let rgb = fitted(&image, &camera).to_bytes();
    Ok(PosedPhoto { name, path, camera, file_camera: frame.camera, rgb, mask, held_out })
}

/// An image brought to its camera's size.
fn fitted(image: &Image, camera: &Camera) -> Image {
    if (image.width, image.height) == (camera.width, camera.height) {
        return image.clone();
    }
    image.resize(camera.width, camera.height, [0.0, 0.0, image.width as f64, image.height as f64])
}

/// The mask of a photo, at the photo's size.
fn mask(frame: &Frame, folder: &Path, camera: &Camera) -> Result<Vec<u8>, Error> {
    let path = mask_path(frame, folder)?;
    let image = Image::read(&path, weaver_io::Background::Black)?;
    check_size(&path, (image.width, image.height), &frame.camera)?;
    Ok(fitted(&image, camera).pixels.chunks_exact(3).map(|p| if p[0] >= 0.5 { 255 } else { 0 }).collect())
}

fn mask_path(frame: &Frame, folder: &Path) -> Result<PathBuf, Error> {
    // Extras are JSON; a path is a string in it.
    let named = frame.extras.get("mask_path").map(|json| folder.join(json.trim_matches('"')));
    let masks = folder.join("masks");
    let photo = Path::new(frame.path.file_name().unwrap_or(frame.path.as_os_str()));
    let behind = format!("{}.png", photo.display());
    let candidates: Vec<PathBuf> = named
        .into_iter()
        .chain([masks.join(photo), masks.join(photo.with_extension("png")), masks.join(behind)])
        .collect();
    let found = candidates.iter().find(|path| path.is_file()).cloned();
    found.ok_or_else(|| {
        let expected = candidates.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(" or ");
        Error::unexpected(&frame.path, "mask", expected, "no such file")
    })
}
