//! Cameras of photos, as camera files describe them.

use std::collections::BTreeMap;
use std::path::PathBuf;
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
