//! transforms.json of nerfstudio, instant-ngp and NeRF-synthetic scenes.

mod lens;

use crate::files::json::{self, kind};
use crate::pictures::photo_file::EXTENSIONS;
use crate::{Error, PhotoFile, Result, atomic_write};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use weaver_geometry::geodesy::{Geographic, Origin};
use weaver_geometry::{Camera, Intrinsics, Pose, axes};
use weaver_scene::Frame;

/// The photographs and cameras of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Transforms {
    /// The photographs, in the order of the file.
    pub frames: Vec<Frame>,
    /// A file of points on surfaces (`ply_file_path`), relative to this file.
    pub point_cloud: Option<PathBuf>,
    /// Names of the frames to train on; empty when the file does not split.
    pub train_filenames: Vec<String>,
    /// Names of the frames to validate on.
    pub val_filenames: Vec<String>,
    /// Names of the frames to test on. `None` where the file does not say; an empty list says that nothing is held out.
    pub test_filenames: Option<Vec<String>>,
    /// The origin of the world on the Earth or in a survey's frame (`origin`), for worlds of meters whose axes are
    /// east, north and up.
    pub origin: Option<Origin>,
}

/// Keys of a frame that [`Frame`] has fields for.
const KNOWN: [&str; 15] = [
    "file_path",
    "transform_matrix",
    "fl_x",
    "fl_y",
    "cx",
    "cy",
    "w",
    "h",
    "camera_angle_x",
    "camera_angle_y",
    "camera_model",
    "is_fisheye",
    "mask_path",
    "time",
    "number",
];

/// True if [`Frame`] has a field for a key.
fn is_known(key: &str) -> bool {
    KNOWN.contains(&key) || lens::is_coefficient(key)
}

impl Transforms {
    /// Reads the file and locates its images.
    ///
    /// A frame's `time` becomes [`Frame::time`], its `number` [`Frame::number`], its `mask_path` [`Frame::mask`];
    /// unknown keys are kept in [`Frame::extras`].
    ///
    /// Intrinsics may stand in the frame or, for all frames, at the top: `fl_x` `fl_y` `cx` `cy` `w` `h`, or
    /// `camera_angle_x` (and `_y`). Missing `fl_y` is `fl_x`, a missing principal point is the image's center, a
    /// missing size is read from the image's header, as it is stored. Likewise the lens: k1, k2, k3, p1 and p2 are
    /// OpenCV's; with the `camera_model` FULL_OPENCV k4, k5 and k6 are, too; with OPENCV_FISHEYE, or `is_fisheye`, k1
    /// to k4 are a fisheye's. THIN_PRISM_FISHEYE, FOV and RAD_TAN_THIN_PRISM_FISHEYE have COLMAP's names of their
    /// parameters as keys. A `file_path` without extension gets the extension of a photo that exists.
    ///
    /// # Errors
    /// When the file is malformed, an image is missing, a lens is of another model, or a matrix is not rigid; when two
    /// entries give one image different cameras. An entry that repeats another one counts once.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        Self::parse(path.as_ref(), true)
    }

    /// Reads the file without looking for its images, for instance to render from its cameras.
    ///
    /// Otherwise like [`Transforms::read`]; where an image is missing, the file must contain its size.
    pub fn read_cameras(path: impl AsRef<Path>) -> Result<Self> {
        Self::parse(path.as_ref(), false)
    }

    fn parse(path: &Path, with_images: bool) -> Result<Self> {
        let root = json::read(path)?;
        let Some(top) = root.as_object() else {
            return Err(Error::invalid(path, "top level", "an object", kind(&root)));
        };
        let Some(list) = top.get("frames").and_then(Value::as_array) else {
            return Err(Error::invalid(path, "frames", "a list", top.get("frames").map_or("nothing", kind)));
        };
        let frame = |(i, value): (usize, &Value)| {
            let place = format!("frames[{i}]");
            match value.as_object() {
                Some(own) => FrameReader { path, place, own, top, with_images }.read(),
                None => Err(Error::invalid(path, place, "an object", kind(value))),
            }
        };
        let point_cloud = match top.get("ply_file_path") {
            None | Some(Value::Null) => None,
            Some(Value::String(name)) => Some(PathBuf::from(name)),
            Some(other) => return Err(Error::invalid(path, "ply_file_path", "a string", kind(other))),
        };
        let mut frames = list.iter().enumerate().map(frame).collect::<Result<_>>()?;
        // A path of cameras may have one name for all that is not there.
        if with_images {
            frames = once_each(path, frames)?;
        }
        Ok(Self {
            point_cloud,
            frames,
            train_filenames: names(path, top, "train_filenames")?.unwrap_or_default(),
            val_filenames: names(path, top, "val_filenames")?.unwrap_or_default(),
            test_filenames: names(path, top, "test_filenames")?,
            origin: origin(path, top)?,
        })
    }

    /// Writes the file in the form of nerfstudio, with intrinsics in every frame and [`Frame::name`] as `file_path`.
    ///
    /// # Errors
    /// When an entry of [`Frame::extras`] is not JSON or has the name of a key with its own field, or the file cannot
    /// be written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let model = lens::model(self.frames.first().and_then(|frame| frame.distortion));
        let frame = |(i, frame): (usize, &Frame)| -> Result<Value> {
            let mut value = to_json(path, i, frame)?;
            let own = lens::model(frame.distortion);
            if own != model {
                value["camera_model"] = json!(own);
            }
            Ok(value)
        };
        let frames: Vec<Value> = self.frames.iter().enumerate().map(frame).collect::<Result<_>>()?;
        let mut root = json!({ "camera_model": model, "frames": frames });
        if let Some(points) = &self.point_cloud {
            root["ply_file_path"] = json!(points.to_string_lossy());
        }
        let splits = [("train_filenames", &self.train_filenames), ("val_filenames", &self.val_filenames)];
        for (key, names) in splits.into_iter().filter(|(_, names)| !names.is_empty()) {
            root[key] = json!(names);
        }
        if let Some(names) = &self.test_filenames {
            root["test_filenames"] = json!(names);
        }
        match self.origin {
            None => {}
            Some(Origin::Geographic(Geographic { latitude, longitude, altitude })) => {
                root["origin"] = json!({ "latitude": latitude, "longitude": longitude, "altitude": altitude });
            }
            Some(Origin::Local { offset }) => root["origin"] = json!({ "offset": offset }),
        }
        atomic_write(path, |w| {
            serde_json::to_writer_pretty(&mut *w, &root)?;
            writeln!(w)
        })
    }
}

/// The frames without those that repeat another one.
fn once_each(path: &Path, frames: Vec<Frame>) -> Result<Vec<Frame>> {
    let mut first = BTreeMap::new();
    let mut kept: Vec<Frame> = Vec::with_capacity(frames.len());
    let camera = |frame: &Frame| (frame.camera, frame.distortion, frame.time);
    for (i, frame) in frames.into_iter().enumerate() {
        let (number, place) = *first.entry(frame.path.clone()).or_insert((i, kept.len()));
        if number == i {
            kept.push(frame);
        } else if camera(&kept[place]) != camera(&frame) {
            let expected = format!("an image that no other entry names, or the camera and time of frames[{number}]");
            let found = format!("{:?} again with another camera or time", frame.name);
            return Err(Error::invalid(path, format!("frames[{i}].file_path"), expected, found));
        }
    }
    Ok(kept)
}

fn to_json(path: &Path, index: usize, frame: &Frame) -> Result<Value> {
    let Camera { pose, intrinsics: k, width, height } = frame.camera;
    let [a, b, c] = axes::to_opengl(&pose).rows();
    let mut value = json!({
        "file_path": frame.name,
        "fl_x": k.fx,
        "fl_y": k.fy,
        "cx": k.cx,
        "cy": k.cy,
        "w": width,
        "h": height,
        "transform_matrix": [a, b, c, [0.0, 0.0, 0.0, 1.0]],
    });
    lens::write(frame.distortion, &mut value);
    if let Some(mask) = &frame.mask {
        value["mask_path"] = json!(mask.to_string_lossy());
    }
    if let Some(time) = frame.time {
        value["time"] = json!(time);
    }
    if let Some(number) = frame.number {
        value["number"] = json!(number);
    }
    for (key, text) in &frame.extras {
        let invalid = |expected: &str, found: &dyn Display| {
            Error::invalid(path, format!("frames[{index}].{key} to write"), expected, found)
        };
        if is_known(key) {
            return Err(invalid("a key without a field of its own", key));
        }
        value[key] = serde_json::from_str(text).map_err(|e| invalid("JSON", &json::not_json(&e, text.as_bytes())))?;
    }
    Ok(value)
}

/// One entry of `frames`, with the file's top level to fall back on.
struct FrameReader<'a> {
    path: &'a Path,
    place: String,
    own: &'a Map<String, Value>,
    top: &'a Map<String, Value>,
    /// True if images that are not there are an error.
    with_images: bool,
}

impl FrameReader<'_> {
    fn read(&self) -> Result<Frame> {
        let name = match self.own.get("file_path") {
            Some(Value::String(name)) => name.clone(),
            other => {
                return Err(self.invalid("file_path", "a string", other.map_or("nothing", kind)));
            }
        };
        let path = self.image_file(&name)?;
        let (width, height) = match (self.size("w")?, self.size("h")?) {
            (Some(width), Some(height)) => (width, height),
            _ => PhotoFile::at(&path)?.stored_size(),
        };
        let intrinsics = self.intrinsics(width, height)?;
        let camera = Camera { pose: self.pose()?, intrinsics, width, height };
        let extras = (self.own.iter())
            .filter(|(key, _)| !is_known(key))
            .map(|(key, value)| (key.clone(), value.to_string()))
            .collect();
        let (distortion, mask) = (self.distortion()?, self.mask()?);
        let (time, number) = (self.time()?, self.photo_number()?);
        Ok(Frame { path, distortion, mask, time, number, extras, ..Frame::new(name, camera) })
    }

    fn image_file(&self, name: &str) -> Result<PathBuf> {
        let file = self.path.parent().unwrap_or(Path::new("")).join(name);
        let with_extension = |extension: &str| {
            let mut full = file.clone().into_os_string();
            full.push(extension);
            PathBuf::from(full)
        };
        let extensions = EXTENSIONS.iter().map(|extension| with_extension(&format!(".{extension}")));
        let there = std::iter::once(file.clone()).chain(extensions).find(|f| f.is_file());
        there
            .or_else(|| (!self.with_images).then(|| file.clone()))
            .ok_or_else(|| self.invalid("file_path", "an image file", format!("no file {}", file.display())))
    }

    fn pose(&self) -> Result<Pose> {
        const KEY: &str = "transform_matrix";
        let expected = "4 rows of 4 numbers";
        let Some(matrix) = self.own.get(KEY).and_then(Value::as_array) else {
            return Err(self.invalid(KEY, expected, self.own.get(KEY).map_or("nothing", kind)));
        };
        // The fourth row says nothing; some writers leave it out.
        if !(3..=4).contains(&matrix.len()) {
            return Err(self.invalid(KEY, expected, format!("{} rows", matrix.len())));
        }
        let mut rows = [[0.0; 4]; 3];
        for (r, (row, from)) in rows.iter_mut().zip(matrix).enumerate() {
            let place = format!("{KEY}[{r}]");
            match from.as_array() {
                Some(values) if values.len() == 4 => {
                    for (c, (to, value)) in row.iter_mut().zip(values).enumerate() {
                        let bad = || self.invalid(format!("{place}[{c}]"), "a finite number", value);
                        *to = value.as_f64().filter(|x| x.is_finite()).ok_or_else(bad)?;
                    }
                }
                Some(values) => return Err(self.invalid(place, "4 numbers", values.len())),
                None => return Err(self.invalid(place, "4 numbers", kind(from))),
            }
        }
        let camera_to_world =
            Pose::from_rows(&rows).map_err(|e| self.invalid(KEY, "a rigid camera-to-world transform", e))?;
        Ok(axes::from_opengl(&camera_to_world))
    }

    fn intrinsics(&self, width: usize, height: usize) -> Result<Intrinsics> {
        let from_angle = |key, size: usize| -> Result<Option<f64>> {
            Ok(self.number(key)?.map(|angle| size as f64 / 2.0 / (angle / 2.0).tan()))
        };
        let fx = match self.number("fl_x")? {
            Some(fx) => fx,
            None => from_angle("camera_angle_x", width)?
                .ok_or_else(|| self.invalid("fl_x", "fl_x or camera_angle_x", "neither"))?,
        };
        let fy = match self.number("fl_y")? {
            Some(fy) => fy,
            None => from_angle("camera_angle_y", height)?.unwrap_or(fx),
        };
        for (key, focal) in [("fl_x", fx), ("fl_y", fy)] {
            if !(focal.is_finite() && focal > 0.0) {
                return Err(self.invalid(key, "a positive focal length", focal));
            }
        }
        let cx = self.number("cx")?.unwrap_or(width as f64 / 2.0);
        let cy = self.number("cy")?.unwrap_or(height as f64 / 2.0);
        Ok(Intrinsics { fx, fy, cx, cy })
    }

    /// `time` of the frame itself, not of the top level.
    fn time(&self) -> Result<Option<f64>> {
        let read = |value: &Value| value.as_f64().ok_or_else(|| self.invalid("time", "a number", value));
        self.own.get("time").map(read).transpose()
    }

    fn mask(&self) -> Result<Option<PathBuf>> {
        match self.own.get("mask_path") {
            None | Some(Value::Null) => Ok(None),
            Some(Value::String(path)) => Ok(Some(PathBuf::from(path))),
            Some(other) => Err(self.invalid("mask_path", "a string", kind(other))),
        }
    }

    fn photo_number(&self) -> Result<Option<u64>> {
        let read = |value: &Value| value.as_u64().ok_or_else(|| self.invalid("number", "a whole number", value));
        self.own.get("number").map(read).transpose()
    }

    fn get(&self, key: &str) -> Option<&Value> {
        self.own.get(key).or_else(|| self.top.get(key))
    }

    fn number(&self, key: &str) -> Result<Option<f64>> {
        match self.get(key) {
            None => Ok(None),
            // nerfstudio quotes the coefficients of RealityScan's tables.
            Some(value) => match value.as_f64().or_else(|| value.as_str()?.trim().parse().ok()) {
                Some(x) => Ok(Some(x)),
                None => Err(self.invalid(key, "a number", value)),
            },
        }
    }

    fn size(&self, key: &str) -> Result<Option<usize>> {
        match self.number(key)? {
            None => Ok(None),
            // Some writers say 384.0.
            Some(x) if x >= 1.0 && x <= f64::from(1 << 20) && x.fract() == 0.0 => Ok(Some(x as usize)),
            Some(x) => Err(self.invalid(key, "a size in pixels", x)),
        }
    }

    fn invalid(&self, key: impl Display, expected: impl Display, found: impl Display) -> Error {
        Error::invalid(self.path, format!("{}.{key}", self.place), expected, found)
    }
}

/// The origin of the world, with the keys latitude, longitude and altitude, or offset.
fn origin(path: &Path, top: &Map<String, Value>) -> Result<Option<Origin>> {
    let Some(value) = top.get("origin").filter(|value| !value.is_null()) else { return Ok(None) };
    if let Some(offset) = json::numbers(&value["offset"]) {
        return Ok(Some(Origin::Local { offset }));
    }
    let number = |key: &str| value[key].as_f64();
    match (number("latitude"), number("longitude"), number("altitude")) {
        (Some(latitude), Some(longitude), Some(altitude)) => {
            Ok(Some(Origin::Geographic(Geographic { latitude, longitude, altitude })))
        }
        _ => Err(Error::invalid(path, "origin", "latitude, longitude and altitude, or an offset", json::found(value))),
    }
}

fn names(path: &Path, top: &Map<String, Value>, key: &str) -> Result<Option<Vec<String>>> {
    let Some(value) = top.get(key) else {
        return Ok(None);
    };
    let list: Option<Vec<String>> =
        value.as_array().and_then(|l| l.iter().map(|n| n.as_str().map(String::from)).collect());
    list.map(Some).ok_or_else(|| Error::invalid(path, key, "a list of strings", kind(value)))
}
