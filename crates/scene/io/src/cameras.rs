//! One reader for every format of camera files.

pub mod colmap;
pub(crate) mod convert;
pub mod dtu;
pub mod llff;
pub mod nerfies;
pub(crate) mod project;
pub mod realestate;
pub(crate) mod transforms;

use crate::{Project, ProjectKind, Result, Transforms};
use colmap::Model;
use realestate::Clip;
use std::path::Path;
use weaver_scene::Frame;

/// Reads the cameras of photos from a transforms.json, from a folder with a COLMAP model, from another program's
/// [project](crate::Project), or from a RealEstate10K file.
///
/// A folder may hold the model itself or in `sparse/0` or `sparse`. Projects are known by their content, RealEstate10K
/// files by `.txt`. Frames keep the order of the file; COLMAP's are sorted by name. The images need not exist, except
/// for projects without sizes.
///
/// A RealEstate10K file does not contain the size of its images. Its cameras are for an image of 1 x 1 pixel;
/// [`Intrinsics::resized`](weaver_geometry::Intrinsics::resized) gives those for any other size.
///
/// # Errors
/// When the file cannot be read or is malformed.
pub fn read_cameras(path: impl AsRef<Path>) -> Result<Vec<Frame>> {
    let path = path.as_ref();
    if path.is_dir() {
        let mut frames = Model::read(colmap::model_folder(path))?.frames();
        frames.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(frames)
    } else if ProjectKind::of(path)?.is_some() {
        Ok(Project::read_cameras(path)?.frames)
    } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("txt")) {
        Ok(Clip::read(path)?.frames.iter().map(|frame| frame.sized(1, 1)).collect())
    } else {
        Ok(Transforms::read_cameras(path)?.frames)
    }
}
