//! Sparse models of COLMAP: cameras, images with their poses, and points.

mod binary;
mod text;

use crate::{Error, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_scene::Frame;

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

/// A pinhole camera that took one or more images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraModel {
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
    /// Intrinsics in pixels, pixel centers at half-integers.
    pub intrinsics: Intrinsics,
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
    /// Reads `cameras`, `images` and `points3D` from a folder: the `.bin` files where they exist, else the `.txt` files.
    ///
    /// Camera models with lens distortion are accepted when every distortion coefficient is exactly zero.
    ///
    /// # Errors
    /// When a file is missing or malformed, or an image refers to a camera that is not in the model.
    pub fn read(folder: impl AsRef<Path>) -> Result<Self> {
        let folder = folder.as_ref();
        let extension = if folder.join("cameras.bin").is_file() { "bin" } else { "txt" };
        let model = Self {
            cameras: read_cameras(&file(folder, "cameras", extension))?,
            images: read_images(&file(folder, "images", extension))?,
            points: read_points(&file(folder, "points3D", extension))?,
        };
        if let Some(image) = model.images.iter().find(|i| !model.cameras.contains_key(&i.camera_id)) {
            let place = format!("image {} ({})", image.id, image.name);
            let found = format!("camera {}, which is not there", image.camera_id);
            return Err(Error::invalid(folder, place, "a camera of the model", found));
        }
        Ok(model)
    }

    /// Makes a model of photos whose cameras are known: one camera for each image, no points.
    pub fn from_frames(frames: &[Frame]) -> Self {
        let mut model = Self::default();
        for (id, frame) in (1..).zip(frames) {
            let Camera { pose, intrinsics, width, height } = frame.camera;
            model.cameras.insert(id, CameraModel { width, height, intrinsics });
            let name = frame.name.clone();
            model.images.push(ImageRecord { id, name, camera_id: id, pose, points: Vec::new() });
        }
        model
    }

    /// The images with their cameras, in the order of the file.
    ///
    /// Images whose camera is missing are left out; there are none in a model that was read from files.
    pub fn frames(&self) -> Vec<Frame> {
        let frame = |image: &ImageRecord| {
            let CameraModel { width, height, intrinsics } = *self.cameras.get(&image.camera_id)?;
            Some(Frame::new(&image.name, Camera { pose: image.pose, intrinsics, width, height }))
        };
        self.images.iter().filter_map(frame).collect()
    }

    /// Writes `cameras.bin`, `images.bin` and `points3D.bin` into an existing folder; cameras become PINHOLE.
    pub fn write_binary(&self, folder: impl AsRef<Path>) -> Result<()> {
        binary::write(self, folder.as_ref())
    }

    /// Writes `cameras.txt`, `images.txt` and `points3D.txt` into an existing folder; cameras become PINHOLE.
    pub fn write_text(&self, folder: impl AsRef<Path>) -> Result<()> {
        text::write(self, folder.as_ref())
    }
}

/// The folder that holds the model of a capture: `sparse/0`, `sparse`, or the capture's folder itself, whichever has one.
pub fn model_folder(folder: impl AsRef<Path>) -> PathBuf {
    let folder = folder.as_ref();
    let candidates = [folder.join("sparse/0"), folder.join("sparse"), folder.to_path_buf()];
    let holds_model = |f: &&PathBuf| f.join("cameras.bin").is_file() || f.join("cameras.txt").is_file();
    let found = candidates.iter().find(holds_model).or(candidates.iter().find(|f| f.is_dir()));
    found.cloned().unwrap_or_else(|| folder.to_path_buf())
}

/// How the parameters of a camera model begin.
#[derive(Clone, Copy)]
enum Focal {
    /// f, cx, cy.
    One,
    /// fx, fy, cx, cy.
    Two,
}

/// COLMAP's camera models: number, name, count of parameters, and how they begin; `None` when the model is no
/// pinhole even without distortion.
const MODELS: [(u32, &str, usize, Option<Focal>); 11] = [
    (0, "SIMPLE_PINHOLE", 3, Some(Focal::One)),
    (1, "PINHOLE", 4, Some(Focal::Two)),
    (2, "SIMPLE_RADIAL", 4, Some(Focal::One)),
    (3, "RADIAL", 5, Some(Focal::One)),
    (4, "OPENCV", 8, Some(Focal::Two)),
    (5, "OPENCV_FISHEYE", 8, None),
    (6, "FULL_OPENCV", 12, Some(Focal::Two)),
    (7, "FOV", 5, None),
    (8, "SIMPLE_RADIAL_FISHEYE", 4, None),
    (9, "RADIAL_FISHEYE", 5, None),
    (10, "THIN_PRISM_FISHEYE", 12, None),
];

/// The number of PINHOLE, which is what gets written.
const PINHOLE: u32 = 1;

/// A camera as a file has it, before its model is interpreted.
struct RawCamera<'a> {
    path: &'a Path,
    id: u32,
    model: &'a str,
    focal: Option<Focal>,
    size: [u64; 2],
    parameters: &'a [f64],
}

impl RawCamera<'_> {
    fn check(&self) -> Result<CameraModel> {
        let invalid = |expected: &str, found: String| {
            Error::invalid(self.path, format!("camera {} ({})", self.id, self.model), expected, found)
        };
        let [width, height] = self.size;
        if !(1..=1 << 20).contains(&width) || !(1..=1 << 20).contains(&height) {
            return Err(invalid("an image size in pixels", format!("{width}x{height}")));
        }
        let (intrinsics, distortion) = match (self.focal, self.parameters) {
            (Some(Focal::One), &[f, cx, cy, ref rest @ ..]) => (Intrinsics { fx: f, fy: f, cx, cy }, rest),
            (Some(Focal::Two), &[fx, fy, cx, cy, ref rest @ ..]) => (Intrinsics { fx, fy, cx, cy }, rest),
            _ => return Err(invalid("a pinhole camera", "another model".into())),
        };
        let Intrinsics { fx, fy, cx, cy } = intrinsics;
        if ![fx, fy, cx, cy].iter().all(|x| x.is_finite()) || fx <= 0.0 || fy <= 0.0 {
            return Err(invalid("finite intrinsics, focal lengths positive", format!("{:?}", self.parameters)));
        }
        if distortion.iter().any(|&k| k != 0.0) {
            return Err(invalid("distortion 0 (undistort the images first)", format!("{distortion:?}")));
        }
        Ok(CameraModel { width: width as usize, height: height as usize, intrinsics })
    }
}

/// The pose of an image record, or what is wrong with it.
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

/// What a pose must be, for messages.
const POSE: &str = "a unit quaternion and a finite translation";

/// Reads the cameras of a model, binary or text by the extension.
pub(crate) fn read_cameras(path: &Path) -> Result<BTreeMap<u32, CameraModel>> {
    if is_binary(path) { binary::cameras(path) } else { text::cameras(path) }
}

/// Reads the images of a model, binary or text by the extension.
pub(crate) fn read_images(path: &Path) -> Result<Vec<ImageRecord>> {
    if is_binary(path) { binary::images(path) } else { text::images(path) }
}

/// Reads the points of a model, binary or text by the extension.
pub(crate) fn read_points(path: &Path) -> Result<Vec<Point>> {
    if is_binary(path) { binary::points(path) } else { text::points(path) }
}

fn is_binary(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "bin")
}

fn file(folder: &Path, stem: &str, extension: &str) -> PathBuf {
    folder.join(stem).with_extension(extension)
}
