//! Photos' cameras as files have them.

use std::collections::BTreeMap;
use std::path::PathBuf;
use weaver_geometry::Camera;

/// The camera of one photo, as a camera file (transforms.json, COLMAP, RealEstate10K) has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// What the file calls the photo: a path relative to the file, a name, or a timestamp.
    pub name: String,
    /// The image file, where the reader looked for it; else [`Frame::name`] as it stands.
    pub path: PathBuf,
    /// Pose, intrinsics and image size.
    pub camera: Camera,
    /// When the photo was taken, in the file's own unit.
    pub time: Option<f64>,
    /// A number that the file gives to the photo, such as its exposure group or its place in a video.
    pub number: Option<u64>,
    /// What else the file says about the photo: JSON text by key.
    pub extras: BTreeMap<String, String>,
}

impl Frame {
    /// A frame of a photo that nothing else is known about.
    pub fn new(name: impl Into<String>, camera: Camera) -> Self {
        let name = name.into();
        Self { path: PathBuf::from(&name), name, camera, time: None, number: None, extras: BTreeMap::new() }
    }
}
