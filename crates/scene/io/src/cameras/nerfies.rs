//! Captures of Nerfies and HyperNeRF: a hand-held camera, or two on a rig, before something that moves.

use crate::files::json::{JsonFile, found, numbers};
use crate::{Error, Npy, Result};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, Pose};

/// Longer sides are taken for errors.
const LONGEST: f64 = 65536.0;

/// A capture without its photos.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// The photos to train on and those to validate on.
    pub frames: Vec<CaptureFrame>,
    /// Photos that dataset.json lists but uses for nothing.
    pub unused: usize,
    /// Offset that was subtracted from positions.
    pub center: DVec3,
    /// Factor on them after that.
    pub scale: f64,
}

/// A photo's camera and time.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureFrame {
    /// Name of its files.
    pub id: String,
    /// Its camera, for the photo of full size.
    pub camera: Camera,
    /// Time of the photo: its `warp_id`, or `time_id` where it has none.
    pub moment: f64,
    /// True if it is kept from training.
    pub validation: bool,
}

impl Capture {
    /// Reads `scene.json` (scale, center), `dataset.json` (ids, train_ids, val_ids), `metadata.json` (by id: warp_id or
    /// time_id) and `camera/<id>.json` (orientation: rows of the world-to-camera rotation; position, focal_length,
    /// principal_point, pixel_aspect_ratio, image_size) of a folder.
    ///
    /// Positions become `(p - center) scale`. `fy` is the focal length times the pixel's aspect ratio.
    ///
    /// # Errors
    /// When a file is missing or malformed, an orientation is not a rotation, or a camera has skew or distortion.
    pub fn read(folder: impl AsRef<Path>) -> Result<Self> {
        let folder = folder.as_ref();
        let scene = JsonFile::open(folder.join("scene.json"))?;
        let scale = scene.number("scale")?;
        if scale <= 0.0 {
            return Err(scene.invalid("scale", "a positive number", scale.to_string()));
        }
        let center = DVec3::from(scene.numbers("center")?);
        let dataset = JsonFile::open(folder.join("dataset.json"))?;
        let list = |key: &str| if dataset.has(key) { dataset.strings(key) } else { Ok(Vec::new()) };
        let (training, validation) = (dataset.strings("train_ids")?, list("val_ids")?);
        let metadata = JsonFile::open(folder.join("metadata.json"))?;
        let kept: BTreeSet<&str> = validation.iter().map(String::as_str).collect();
        let mut used = BTreeSet::new();
        let mut frames = Vec::new();
        for id in training.iter().chain(&validation).filter(|id| used.insert(id.as_str())) {
            let file = JsonFile::open(folder.join("camera").join(format!("{id}.json")))?;
            let mut camera = camera(&file)?;
            // R (p - c) s: the rotation stays, and the translation follows from the new center.
            let position = (camera.pose.center() - center) * scale;
            camera.pose.translation = -(camera.pose.rotation * position);
            if !camera.pose.translation.is_finite() {
                return Err(file.invalid("position", "a finite one once centered and scaled", position.to_string()));
            }
            let (moment, validation) = (moment(&metadata, id)?, kept.contains(id.as_str()));
            frames.push(CaptureFrame { id: id.clone(), camera, moment, validation });
        }
        let unused = list("ids")?.iter().filter(|id| !used.contains(id.as_str())).count();
        Ok(Self { frames, unused, center, scale })
    }

    /// Reads `points.npy`, `[N, 3]`, of the folder, in the frame of the cameras; `None` if there is none.
    ///
    /// # Errors
    /// When the file is no NPY file of this shape, or a number is not finite.
    pub fn points(&self, folder: impl AsRef<Path>) -> Result<Option<Vec<DVec3>>> {
        let path: PathBuf = folder.as_ref().join("points.npy");
        if !path.is_file() {
            return Ok(None);
        }
        let array = Npy::open(&path)?;
        let [_, 3] = *array.shape() else {
            return Err(Error::invalid(&path, "shape", "[points, 3]", format!("{:?}", array.shape())));
        };
        let numbers = array.doubles(0..array.len());
        if let Some(at) = numbers.iter().position(|x| !x.is_finite()) {
            return Err(Error::invalid(&path, format!("point {}", at / 3), "finite numbers", numbers[at]));
        }
        let triples = numbers.as_chunks::<3>().0;
        Ok(Some(triples.iter().map(|p| (DVec3::from(*p) - self.center) * self.scale).collect()))
    }
}

/// When a photo was taken.
fn moment(metadata: &JsonFile, id: &str) -> Result<f64> {
    let entry = metadata.get(id);
    let time = ["warp_id", "time_id"].into_iter().find_map(|key| entry[key].as_f64());
    time.ok_or_else(|| metadata.invalid(id, "warp_id or time_id, a number", found(entry)))
}

/// A camera where it stands.
fn camera(file: &JsonFile) -> Result<Camera> {
    let number_or = |key: &str, otherwise: f64| if file.has(key) { file.number(key) } else { Ok(otherwise) };
    let skew = number_or("skew", 0.0)?;
    if skew != 0.0 {
        return Err(file.invalid("skew", "0: others are not supported", skew.to_string()));
    }
    for key in ["radial_distortion", "tangential_distortion"].into_iter().filter(|key| file.has(key)) {
        let none = file.get(key).as_array().is_some_and(|list| list.iter().all(|x| x.as_f64() == Some(0.0)));
        if !none {
            let expected = "zeros: photos have to be undistorted";
            return Err(file.invalid(key, expected, found(file.get(key))));
        }
    }
    let focal = file.number("focal_length")?;
    let aspect = number_or("pixel_aspect_ratio", 1.0)?;
    for (key, value) in [("focal_length", focal), ("pixel_aspect_ratio", aspect)] {
        if value <= 0.0 {
            return Err(file.invalid(key, "a positive number", value.to_string()));
        }
    }
    let [cx, cy] = file.numbers("principal_point")?;
    let size: [f64; 2] = file.numbers("image_size")?;
    if !size.iter().all(|side| (1.0..=LONGEST).contains(side) && side.fract() == 0.0) {
        return Err(file.invalid("image_size", "width and height in pixels", format!("{size:?}")));
    }
    let orientation = file.get("orientation");
    let rows: Option<[[f64; 3]; 3]> =
        orientation.as_array().and_then(|rows| rows.iter().map(numbers).collect::<Option<Vec<_>>>()?.try_into().ok());
    let rows = rows.ok_or_else(|| file.invalid("orientation", "3 rows of 3 numbers", found(orientation)))?;
    let rotation = Pose::from_rows(&rows.map(|[a, b, c]| [a, b, c, 0.0]))
        .map_err(|e| file.invalid("orientation", "the rows of a rotation", e.to_string()))?
        .rotation;
    let position = DVec3::from(file.numbers("position")?);
    let intrinsics = Intrinsics { fx: focal, fy: focal * aspect, cx, cy };
    let pose = Pose::new(rotation, -(rotation * position));
    Ok(Camera { pose, intrinsics, width: size[0] as usize, height: size[1] as usize })
}
