//! Captures described by `transforms.json` files.

use super::photo::{Photo, Photos};
use super::sparse;
use crate::Error;
use std::path::Path;
use weaver_geometry::Pose;
use weaver_io::Transforms;
use weaver_io::colmap::Model;
use weaver_scene::Frame;

/// How far a camera may turn (radians) or move (of the cameras' extent) between `transforms.json` and the sparse
/// model before they are taken for two different worlds.
const SAME_WORLD: f64 = 0.02;

/// One `transforms.json`, with the points of a COLMAP model beside it where there is one.
pub(super) fn read(path: &Path) -> Result<Photos, Error> {
    with_points(path, &Transforms::read(path)?)
}

/// As [`read`], where the images need not exist.
pub(super) fn read_cameras(path: &Path) -> Result<Photos, Error> {
    with_points(path, &Transforms::read_cameras(path)?)
}

fn with_points(path: &Path, transforms: &Transforms) -> Result<Photos, Error> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let held_out = &transforms.test_filenames;
    if let Some(name) = held_out.iter().find(|&name| transforms.frames.iter().all(|f| f.name != *name)) {
        return Err(Error::unexpected(path, "test_filenames", "the file_path of a frame", name.as_str()));
    }
    let mut capture = Photos {
        photos: transforms.frames.iter().map(|f| photo(f, held_out.contains(&f.name))).collect(),
        points: Vec::new(),
        colors: Vec::new(),
        split: !held_out.is_empty(),
    };
    if folder.join("sparse").exists() {
        let sparse_folder = sparse::folder(folder);
        let model = Model::read(&sparse_folder)?;
        add_points(&mut capture, &model, &sparse_folder)?;
    }
    Ok(capture)
}

/// `transforms_train.json` and `transforms_test.json`: transparent pixels become white, the test file is held out.
pub(super) fn read_split(folder: &Path) -> Result<Photos, Error> {
    let training = Transforms::read(folder.join("transforms_train.json"))?;
    let test = Transforms::read(folder.join("transforms_test.json"))?;
    let photos = training.frames.iter().map(|f| photo(f, false));
    let photos = photos.chain(test.frames.iter().map(|f| photo(f, true))).collect();
    Ok(Photos { photos, points: Vec::new(), colors: Vec::new(), split: true })
}

fn photo(frame: &Frame, held_out: bool) -> Photo {
    Photo { frame: frame.clone(), held_out, track: Vec::new() }
}

/// Gives the photos the points that the model's images of the same name observe.
fn add_points(capture: &mut Photos, model: &Model, folder: &Path) -> Result<(), Error> {
    let extent = extent(capture.photos.iter().map(|photo| &photo.frame.camera.pose));
    let index = sparse::index(model);
    for photo in &mut capture.photos {
        let named = model.images.iter().filter(|record| photo.frame.path.ends_with(&record.name));
        let Some(record) = named.max_by_key(|record| record.name.len()) else {
            continue;
        };
        let (ours, theirs) = (&photo.frame.camera.pose, &record.pose);
        let moved = ours.center().distance(theirs.center());
        let turned = ours.angle_to(theirs);
        if turned > SAME_WORLD || moved > SAME_WORLD * extent {
            let found = format!("a camera turned by {turned:.3} rad and moved by {moved:.3}");
            return Err(Error::unexpected(folder, record.name.as_str(), "the pose in transforms.json", found));
        }
        photo.track = sparse::track(record, &index);
    }
    (capture.points, capture.colors) = (sparse::points(model), sparse::colors(model));
    Ok(())
}

/// Largest distance of a camera from the first.
fn extent<'a>(poses: impl Iterator<Item = &'a Pose>) -> f64 {
    let mut centers = poses.map(Pose::center);
    let Some(first) = centers.next() else { return 0.0 };
    centers.map(|c| c.distance(first)).fold(0.0, f64::max)
}
