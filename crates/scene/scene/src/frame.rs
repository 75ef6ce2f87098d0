//! Cameras of photos, as camera files describe them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use weaver_geometry::{Camera, Distortion};

/// One photo and its camera, as a camera file (transforms.json, COLMAP, RealEstate10K) describes them.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Frame {
    /// Name of the photo in the file: a path relative to the file, a name, or a timestamp.
    pub name: String,
    /// Path of the image file, if the reader located it; else [`Frame::name`].
    pub path: PathBuf,
    /// Pose, intrinsics and image size.
    pub camera: Camera,
    /// Distortion of the lens, if there is one.
    pub distortion: Option<Distortion>,
    /// The photo's mask, as the file names it.
    pub mask: Option<PathBuf>,
    /// When the photo was taken, in the unit of the file.
    pub time: Option<f64>,
    /// A number that the file gives to the photo, such as its exposure group or its place in a video.
    pub number: Option<u64>,
    /// Further entries of the file about the photo: JSON text by key.
    pub extras: BTreeMap<String, String>,
}

impl Frame {
    /// A frame with a name and a camera alone.
    pub fn new(name: impl Into<String>, camera: Camera) -> Self {
        let name = name.into();
        let path = PathBuf::from(&name);
        Self { name, path, camera, distortion: None, mask: None, time: None, number: None, extras: BTreeMap::new() }
    }
}

/// File names for pictures of these cameras: the stems of their photos where those are distinct, else numbers.
///
/// ```
/// use weaver_geometry::{Camera, Intrinsics, Pose};
/// use weaver_scene::{Frame, stems};
/// let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 40.0, cy: 30.0 };
/// let camera = Camera { pose: Pose::IDENTITY, intrinsics, width: 80, height: 60 };
/// let named = |names: [&str; 2]| stems(&names.map(|name| Frame::new(name, camera)));
/// assert_eq!(named(["images/a.png", "images/b.jpg"]), ["a", "b"]);
/// assert_eq!(named(["left/a.png", "right/A.png"]), ["0000", "0001"]);
/// assert_eq!(named(["", "a"]), ["0000", "0001"]);
/// ```
pub fn stems(cameras: &[Frame]) -> Vec<String> {
    let stem = |c: &Frame| Path::new(&c.name).file_stem().map_or(String::new(), |s| s.to_string_lossy().into_owned());
    let stems: Vec<String> = cameras.iter().map(stem).collect();
    // Without regard to case, as some file systems see it.
    let distinct: BTreeSet<String> = stems.iter().map(|s| s.to_lowercase()).filter(|s| !s.is_empty()).collect();
    if distinct.len() == stems.len() { stems } else { (0..cameras.len()).map(|i| format!("{i:04}")).collect() }
}
