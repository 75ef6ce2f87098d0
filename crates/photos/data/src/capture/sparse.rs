//! Captures described by a COLMAP model, and the points of such a model.

use super::by_name;
use super::photo::{Photo, Photos};
use crate::Error;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use weaver_geometry::glam::DVec3;
use weaver_io::colmap::{ImageRecord, Model};
use weaver_scene::Frame;

/// Photos in `images/`, cameras and points in `sparse/0`.
pub(super) fn read(capture: &Path) -> Result<Photos, Error> {
    let (model, images) = (folder(capture), capture.join("images"));
    let mut photos = photos(&Model::read(&model)?, &[&images, capture]);
    let unused = unused(&photos, &images)?;
    if !unused.is_empty() {
        let (model, unused) = (model.display(), by_name::list(unused.iter().map(|path| path.display())));
        photos.remarks.push(format!("{model}: photos that are not in the model, and are not used: {unused}"));
    }
    Ok(photos)
}

/// The photos beside the ones of a model.
fn unused(capture: &Photos, images: &Path) -> Result<Vec<PathBuf>, Error> {
    let known: BTreeSet<&Path> = capture.photos.iter().map(|photo| photo.frame.path.as_path()).collect();
    let folders: BTreeSet<&Path> = known.iter().filter_map(|path| path.parent()).chain([images]).collect();
    let mut unused = Vec::new();
    for folder in folders.into_iter().filter(|folder| folder.is_dir()) {
        unused.extend(weaver_io::list_photos(folder)?.into_iter().filter(|path| !known.contains(path.as_path())));
    }
    Ok(unused)
}

/// The photos of a model, each in the first of the `folders` that has it, and its points. The names of estimated
/// cameras are relative to the capture, COLMAP's to a folder of images.
pub(super) fn photos(model: &Model, folders: &[&Path]) -> Photos {
    let path = |name: &str| {
        let mut places = folders.iter().map(|folder| folder.join(name));
        places.clone().find(|path| path.is_file()).or(places.next()).unwrap_or_else(|| name.into())
    };
    let index = index(model);
    let photo = |(record, frame): (&ImageRecord, Frame)| Photo {
        frame: Frame { path: path(&record.name), ..frame },
        held_out: false,
        track: track(record, &index),
    };
    // Reading the model made sure that every image has its camera.
    let photos = model.images.iter().zip(model.frames()).map(photo).collect();
    Photos { photos, points: points(model), colors: colors(model), ..Photos::default() }
}

/// The folder of a capture's model: `sparse/0`, or `sparse` itself.
pub(super) fn folder(capture: &Path) -> PathBuf {
    let sparse = capture.join("sparse");
    let numbered = sparse.join("0");
    if numbered.exists() { numbered } else { sparse }
}

/// Positions in the model's list of points, by id.
pub(super) fn index(model: &Model) -> BTreeMap<u64, u32> {
    model.points.iter().zip(0..).map(|(point, i)| (point.id, i)).collect()
}

/// The points an image observes: ascending, each once. Observations of points that the model dropped are left out.
pub(super) fn track(record: &ImageRecord, index: &BTreeMap<u64, u32>) -> Vec<u32> {
    let mut track: Vec<u32> = record.points.iter().filter_map(|(_, _, id)| index.get(&(*id)?).copied()).collect();
    track.sort_unstable();
    track.dedup();
    track
}

/// World positions, in the model's order.
pub(super) fn points(model: &Model) -> Vec<DVec3> {
    model.points.iter().map(|point| DVec3::from(point.xyz)).collect()
}

/// Colors, in the model's order.
pub(super) fn colors(model: &Model) -> Vec<[u8; 3]> {
    model.points.iter().map(|point| point.rgb).collect()
}
