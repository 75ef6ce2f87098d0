//! Sparse models of COLMAP: cameras, images with their poses, and points.

mod binary;
mod camera;
mod text;

use crate::files::file::{read_bytes, utf8};
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weaver_geometry::{Camera, Distortion, Intrinsics, Pose};
use weaver_scene::Frame;

/// The key under which [`Model::frames`] keeps the id of a photo's camera.
pub const CAMERA_ID: &str = "colmap_camera_id";

/// A sparse model: the result of structure from motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// The cameras by id.
    pub cameras: BTreeMap<u32, CameraModel>,
    /// The registered images, in the order of the file.
    pub images: Vec<ImageRecord>,
    /// The triangulated points, in the order of the file.
    pub points: Vec<Point>,
}

/// A camera that took one or more images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraModel {
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
    /// Intrinsics in pixels, pixel centers at half-integers.
    pub intrinsics: Intrinsics,
    /// Distortion of the lens, if there is one.
    pub distortion: Option<Distortion>,
}

/// A registered image.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageRecord {
    /// The image's id.
    pub id: u32,
    /// File name relative to the image folder.
    pub name: String,
    /// Key into [`Model::cameras`].
    pub camera_id: u32,
    /// OpenCV world-to-camera.
    pub pose: Pose,
    /// Keypoints x, y in pixels and the id of the point that each observes.
    pub points: Vec<(f64, f64, Option<u64>)>,
}

/// A triangulated point.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// The point's id.
    pub id: u64,
    /// World position.
    pub xyz: [f64; 3],
    /// Mean color.
    pub rgb: [u8; 3],
    /// Mean reprojection error, pixels.
    pub error: f64,
    /// Image ids and keypoint indices that observe it.
    pub track: Vec<(u32, u32)>,
}

impl Model {
    /// The files that [`write_binary`](Self::write_binary) writes.
    pub const FILES: [&str; 3] = ["cameras.bin", "images.bin", "points3D.bin"];

    /// Reads `cameras`, `images` and `points3D` from a folder: the `.bin` files where they exist, else the `.txt`
    /// files.
    ///
    /// A `points3D.ply` takes the place of points that are in neither form; its points have no observations.
    ///
    /// # Errors
    /// When a file is missing or malformed, a camera's model is unknown, or an image refers to a camera that is not in
    /// the model.
    pub fn read(folder: impl AsRef<Path>) -> Result<Self> {
        let folder = folder.as_ref();
        let extension = if folder.join("cameras.bin").is_file() { "bin" } else { "txt" };
        let model = Self {
            cameras: read_cameras(&file(folder, "cameras", extension))?,
            images: read_images(&file(folder, "images", extension))?,
            points: points_of(folder, extension)?,
        };
        model.checked(folder)
    }

    /// The model, whose images have cameras.
    fn checked(self, origin: &Path) -> Result<Self> {
        match self.images.iter().find(|i| !self.cameras.contains_key(&i.camera_id)) {
            None => Ok(self),
            Some(image) => {
                let place = format!("image {} ({})", image.id, image.name);
                let found = format!("camera {}, which is not there", image.camera_id);
                Err(Error::invalid(origin, place, "a camera of the model", found))
            }
        }
    }

    /// Makes a model of photos whose cameras are known, without points. Frames whose size, intrinsics and distortion
    /// are equal to the bit share a camera, so that other programs adjust one lens; ids count from 1 in the order of
    /// first appearance.
    pub fn from_frames(frames: &[Frame]) -> Self {
        let mut model = Self::default();
        let mut known = BTreeMap::new();
        for (id, frame) in (1..).zip(frames) {
            let Camera { pose, intrinsics, width, height } = frame.camera;
            let camera = CameraModel { width, height, intrinsics, distortion: frame.distortion };
            let next = known.len() as u32 + 1;
            let camera_id = *known.entry(camera.bits()).or_insert(next);
            model.cameras.entry(camera_id).or_insert(camera);
            model.images.push(ImageRecord { id, name: frame.name.clone(), camera_id, pose, points: Vec::new() });
        }
        model
    }

    /// The images with their cameras, in the order of the file: an image's id is the frame's number; the id of its
    /// camera, which photos share, is among [`Frame::extras`] as [`CAMERA_ID`].
    ///
    /// Images whose camera is missing are left out; there are none in a model that was read from files.
    pub fn frames(&self) -> Vec<Frame> {
        let frame = |image: &ImageRecord| {
            let CameraModel { width, height, intrinsics, distortion } = *self.cameras.get(&image.camera_id)?;
            let camera = Camera { pose: image.pose, intrinsics, width, height };
            let number = Some(image.id.into());
            let extras = BTreeMap::from([(CAMERA_ID.to_string(), image.camera_id.to_string())]);
            Some(Frame { distortion, number, extras, ..Frame::new(&image.name, camera) })
        };
        self.images.iter().filter_map(frame).collect()
    }

    /// Writes `cameras.bin`, `images.bin` and `points3D.bin` into an existing folder; cameras become PINHOLE, OPENCV,
    /// FULL_OPENCV or the fisheye model that they have, whichever is enough.
    pub fn write_binary(&self, folder: impl AsRef<Path>) -> Result<()> {
        binary::write(self, folder.as_ref())
    }

    /// Writes `cameras.txt`, `images.txt` and `points3D.txt` into an existing folder; cameras become PINHOLE, OPENCV,
    /// FULL_OPENCV or the fisheye model that they have, whichever is enough.
    pub fn write_text(&self, folder: impl AsRef<Path>) -> Result<()> {
        text::write(self, folder.as_ref())
    }
}

impl CameraModel {
    /// All that it is made of, to the bit.
    fn bits(&self) -> Vec<u64> {
        let Intrinsics { fx, fy, cx, cy } = self.intrinsics;
        let numbers = match self.distortion {
            None => vec![],
            Some(Distortion::Radial { k, p }) => [&k[..], &p].concat(),
            Some(Distortion::Fisheye { k }) => k.to_vec(),
            Some(Distortion::ThinPrismFisheye { k, p, s }) => [&k[..], &p, &s].concat(),
            Some(Distortion::Fov { omega }) => vec![omega],
            Some(Distortion::RadTanThinPrism { k, p, s }) => [&k[..], &p, &s].concat(),
        };
        let sizes = [self.width as u64, self.height as u64];
        sizes.into_iter().chain([fx, fy, cx, cy].iter().chain(&numbers).map(|x| x.to_bits())).collect()
    }
}

/// The folder that holds the model of a capture: `sparse/0`, `sparse`, or the capture's folder itself, whichever has
/// one.
pub fn model_folder(folder: impl AsRef<Path>) -> PathBuf {
    let folder = folder.as_ref();
    let candidates = [folder.join("sparse/0"), folder.join("sparse"), folder.to_path_buf()];
    let holds_model = |f: &&PathBuf| f.join("cameras.bin").is_file() || f.join("cameras.txt").is_file();
    let found = candidates.iter().find(holds_model).or(candidates.iter().find(|f| f.is_dir()));
    found.cloned().unwrap_or_else(|| folder.to_path_buf())
}

/// The pose of an image record, or the fault in it.
fn pose(wxyz: [f64; 4], t: [f64; 3]) -> std::result::Result<Pose, String> {
    let norm = wxyz.iter().map(|x| x * x).sum::<f64>().sqrt();
    // Also false for NaN and for infinities.
    let unit = (norm - 1.0).abs() < 1e-2;
    if unit && t.iter().all(|x| x.is_finite()) {
        Ok(Pose::from_wxyz(wxyz, t.into()))
    } else {
        Err(format!("quaternion {wxyz:?}, translation {t:?}"))
    }
}

/// Expected pose, for messages.
const POSE: &str = "a unit quaternion and a finite translation";

/// The points of a model.
fn points_of(folder: &Path, extension: &str) -> Result<Vec<Point>> {
    let (own, cloud) = (file(folder, "points3D", extension), file(folder, "points3D", "ply"));
    if own.exists() || !cloud.is_file() {
        return read_points(&own);
    }
    let cloud = crate::gaussians::ply::read_points(cloud)?;
    let point = |(id, (xyz, rgb)): (u64, (&[f32; 3], &[u8; 3]))| Point {
        id,
        xyz: xyz.map(f64::from),
        rgb: *rgb,
        error: 0.0,
        track: Vec::new(),
    };
    Ok((1..).zip(cloud.positions.iter().zip(&cloud.colors)).map(point).collect())
}

/// Reads the cameras of a model.
pub(crate) fn read_cameras(path: &Path) -> Result<BTreeMap<u32, CameraModel>> {
    cameras(path, &read_bytes(path)?)
}

/// Reads the images of a model.
pub(crate) fn read_images(path: &Path) -> Result<Vec<ImageRecord>> {
    images(path, &read_bytes(path)?)
}

/// Reads the points of a model.
pub(crate) fn read_points(path: &Path) -> Result<Vec<Point>> {
    points(path, &read_bytes(path)?)
}

// Binary or text by the name's extension.

fn cameras(path: &Path, data: &[u8]) -> Result<BTreeMap<u32, CameraModel>> {
    if is_binary(path) { binary::cameras(path, data) } else { text::cameras(path, utf8(path, data)?) }
}

fn images(path: &Path, data: &[u8]) -> Result<Vec<ImageRecord>> {
    if is_binary(path) { binary::images(path, data) } else { text::images(path, utf8(path, data)?) }
}

fn points(path: &Path, data: &[u8]) -> Result<Vec<Point>> {
    if is_binary(path) { binary::points(path, data) } else { text::points(path, utf8(path, data)?) }
}

fn is_binary(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "bin")
}

fn file(folder: &Path, stem: &str, extension: &str) -> PathBuf {
    folder.join(stem).with_extension(extension)
}
