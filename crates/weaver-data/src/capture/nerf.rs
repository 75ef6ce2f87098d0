//! Captures described by `transforms.json` files.

use super::photo::{Photo, Photos};
use super::{by_name, sparse};
use crate::Error;
use std::path::Path;
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
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
        split: !held_out.is_empty(),
        ..Photos::default()
    };
    if folder.join("sparse").exists() {
        let sparse_folder = sparse::folder(folder);
        let model = Model::read(&sparse_folder)?;
        add_points(&mut capture, &model, &sparse_folder)?;
    }
    if capture.points.is_empty() {
        add_point_cloud(&mut capture, transforms.point_cloud.as_deref(), folder)?;
    }
    Ok(capture)
}

/// `transforms_train.json` and `transforms_test.json`: transparent pixels become white, the test file is held out.
pub(super) fn read_split(folder: &Path) -> Result<Photos, Error> {
    let training = Transforms::read(folder.join("transforms_train.json"))?;
    let test = Transforms::read(folder.join("transforms_test.json"))?;
    let photos = training.frames.iter().map(|f| photo(f, false));
    let photos = photos.chain(test.frames.iter().map(|f| photo(f, true))).collect();
    Ok(Photos { photos, split: true, ..Photos::default() })
}

fn photo(frame: &Frame, held_out: bool) -> Photo {
    Photo { frame: frame.clone(), held_out, track: Vec::new() }
}

/// Gives the photos the points that the model's images of the same name observe.
fn add_points(capture: &mut Photos, model: &Model, folder: &Path) -> Result<(), Error> {
    let extent = extent(capture.photos.iter().map(|photo| &photo.frame.camera.pose));
    let index = sparse::index(model);
    let mut unknown = Vec::new();
    for photo in &mut capture.photos {
        let named = model.images.iter().filter(|record| photo.frame.path.ends_with(&record.name));
        let Some(record) = named.max_by_key(|record| record.name.len()) else {
            unknown.push(photo.frame.name.clone());
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
    if !unknown.is_empty() {
        let (folder, unknown) = (folder.display(), by_name::list(unknown.iter()));
        capture
            .remarks
            .push(format!("{folder}: photos that are not in the model, and see none of its points: {unknown}"));
    }
    (capture.points, capture.colors) = (sparse::points(model), sparse::colors(model));
    Ok(())
}

/// Gives the capture the points of a PLY file: the one that its transforms.json names, `sparse_pc.ply` or `points3D.ply`.
fn add_point_cloud(capture: &mut Photos, named: Option<&Path>, folder: &Path) -> Result<(), Error> {
    let named = named.map(|path| folder.join(path));
    if let Some(path) = named.as_ref().filter(|path| !path.is_file()) {
        capture.remarks.push(format!("{}: no such file, although transforms.json names it: no points", path.display()));
    }
    let usual = ["sparse_pc.ply", "points3D.ply"].map(|name| folder.join(name));
    let Some(file) = named.into_iter().chain(usual).find(|path| path.is_file()) else { return Ok(()) };
    let cloud = weaver_io::ply::read_points(file)?;
    capture.points = cloud.positions.iter().map(|p| DVec3::from(p.map(f64::from))).collect();
    capture.colors = cloud.colors;
    Ok(())
}

/// Largest distance of a camera from the first.
fn extent<'a>(poses: impl Iterator<Item = &'a Pose>) -> f64 {
    let mut centers = poses.map(Pose::center);
    let Some(first) = centers.next() else { return 0.0 };
    centers.map(|c| c.distance(first)).fold(0.0, f64::max)
}
