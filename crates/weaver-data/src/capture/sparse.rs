//! Captures described by a COLMAP model, and the points of such a model.

use super::photo::{Photo, Photos};
use crate::Error;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weaver_geometry::glam::DVec3;
use weaver_io::colmap::{ImageRecord, Model};
use weaver_scene::Frame;

/// Photos in `images/`, cameras and points in `sparse/0`.
pub(super) fn read(capture: &Path) -> Result<Photos, Error> {
    Ok(photos(&Model::read(folder(capture))?, &capture.join("images")))
}

/// The photos of a model, which lie in the folder `images`, and its points.
pub(super) fn photos(model: &Model, images: &Path) -> Photos {
    let index = index(model);
    let photo = |(record, frame): (&ImageRecord, Frame)| Photo {
        frame: Frame { path: images.join(&record.name), ..frame },
        held_out: false,
        track: track(record, &index),
    };
    // Reading the model made sure that every image has its camera.
    let photos = model.images.iter().zip(model.frames()).map(photo).collect();
    Photos { photos, points: points(model), colors: colors(model), split: false }
}

/// Where a capture keeps its model: `sparse/0`, or `sparse` itself.
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
