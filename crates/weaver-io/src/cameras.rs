//! Cameras from whatever file holds some.

use crate::colmap::Model;
use crate::realestate::Clip;
use crate::{Result, Transforms, colmap};
use std::path::Path;
use weaver_scene::Frame;

/// Reads the cameras of photos: of a transforms.json, of a folder with a COLMAP model (itself, in `sparse` or in
/// `sparse/0`), or of a RealEstate10K file (`.txt`).
///
/// Frames come in the order of the file; those of COLMAP, which has none of use, are sorted by name. Images need not be
/// there. A RealEstate10K file does not tell the size of its images: its cameras are those of images of 1 x 1 pixel, for
/// [`Intrinsics::resized`](weaver_geometry::Intrinsics::resized).
///
/// # Errors
/// When the file cannot be read or is malformed.
pub fn read_cameras(path: impl AsRef<Path>) -> Result<Vec<Frame>> {
    let path = path.as_ref();
    if path.is_dir() {
        let mut frames = Model::read(colmap::model_folder(path))?.frames();
        frames.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(frames)
    } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("txt")) {
        Ok(Clip::read(path)?.frames.iter().map(|frame| frame.sized(1, 1)).collect())
    } else {
        Ok(Transforms::read_cameras(path)?.frames)
    }
}
