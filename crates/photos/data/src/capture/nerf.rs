//! Captures described by `transforms.json` files.

use super::by_name::{self, parts};
use super::photo::{Photo, Photos};
use super::sparse;
use crate::Error;
use std::path::Path;
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
use weaver_io::Transforms;
use weaver_io::colmap::{ImageRecord, Model};
use weaver_scene::Frame;

/// Largest turn (radians) or movement (of the cameras' extent) of a camera between `transforms.json` and the sparse
/// model before they are taken for two different worlds.
const SAME_WORLD: f64 = 0.02;

/// The file that holds a folder's own cameras.
const USUAL: &str = "transforms.json";

/// The files of synthetic scenes.
const SYNTHETIC: [&str; 3] = ["transforms_train.json", "transforms_test.json", "transforms_val.json"];

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
    let held_out = transforms.test_filenames.as_deref().unwrap_or_default();
    if let Some(name) = held_out.iter().find(|&name| transforms.frames.iter().all(|f| f.name != *name)) {
        return Err(Error::unexpected(path, "test_filenames", "the file_path of a frame", name.as_str()));
    }
    let mut capture = Photos {
        photos: transforms.frames.iter().map(|f| photo(f, held_out.contains(&f.name))).collect(),
        split: transforms.test_filenames.is_some(),
        origin: transforms.origin,
        synthetic: path.file_name().is_some_and(|name| SYNTHETIC.iter().any(|known| name == *known)),
        ..Photos::default()
    };
    let mut foreign = false;
    if folder.join("sparse").exists() {
        let sparse_folder = sparse::folder(folder);
        let model = Model::read(&sparse_folder)?;
        // A model beside a folder's own cameras is in their world; first guesses and other cameras may be in any.
        match another_world(&capture, &model) {
            None => add_points(&mut capture, &model, &sparse_folder),
            Some((name, found)) if path.ends_with(USUAL) => {
                return Err(Error::unexpected(&sparse_folder, name, "the pose in transforms.json", found));
            }
            Some((name, found)) => {
                foreign = true;
                let (file, model) = (path.display(), sparse_folder.display());
                capture.remarks.push(format!("{file}: {name}: {found} from its pose in {model}: no points"));
            }
        }
    }
    if capture.points.is_empty() && !foreign {
        add_point_cloud(&mut capture, transforms.point_cloud.as_deref(), folder)?;
    }
    Ok(capture)
}

/// `transforms_train.json` and `transforms_test.json`: transparent pixels become white, the test file is held out.
pub(super) fn read_split(folder: &Path) -> Result<Photos, Error> {
    let [training, test, _] = SYNTHETIC;
    let training = Transforms::read(folder.join(training))?;
    let test = Transforms::read(folder.join(test))?;
    let photos = training.frames.iter().map(|f| photo(f, false));
    let photos = photos.chain(test.frames.iter().map(|f| photo(f, true))).collect();
    Ok(Photos { photos, split: true, synthetic: true, ..Photos::default() })
}

fn photo(frame: &Frame, held_out: bool) -> Photo {
    Photo { frame: frame.clone(), held_out, track: Vec::new() }
}

/// The model's image of a photo.
fn record_of<'m>(model: &'m Model, photo: &Photo) -> Option<&'m ImageRecord> {
    // Images of the same name in both files are the same.
    if let Some(record) = model.images.iter().find(|record| record.name == photo.frame.name) {
        return Some(record);
    }
    let path = parts(&photo.frame.path);
    let named = model.images.iter().map(|record| (parts(Path::new(&record.name)), record));
    let named = named.filter(|(name, _)| !name.is_empty() && path.starts_with(name));
    named.max_by_key(|(name, _)| name.len()).map(|(_, record)| record)
}

/// The first photo that was taken elsewhere in the model, and how far from there.
fn another_world<'m>(capture: &Photos, model: &'m Model) -> Option<(&'m str, String)> {
    let extent = extent(capture.photos.iter().map(|photo| &photo.frame.camera.pose));
    capture.photos.iter().find_map(|photo| {
        let record = record_of(model, photo)?;
        let (ours, theirs) = (&photo.frame.camera.pose, &record.pose);
        let moved = ours.center().distance(theirs.center());
        let turned = ours.angle_to(theirs);
        let differs = turned > SAME_WORLD || moved > SAME_WORLD * extent;
        differs.then(|| (record.name.as_str(), format!("a camera turned by {turned:.3} rad and moved by {moved:.3}")))
    })
}

/// Gives the photos the points that the model's images of the same name observe.
fn add_points(capture: &mut Photos, model: &Model, folder: &Path) {
    let index = sparse::index(model);
    let mut unknown = Vec::new();
    for photo in &mut capture.photos {
        match record_of(model, photo) {
            Some(record) => photo.track = sparse::track(record, &index),
            None => unknown.push(photo.frame.name.clone()),
        }
    }
    if !unknown.is_empty() {
        let (folder, unknown) = (folder.display(), by_name::list(unknown.iter()));
        capture
            .remarks
            .push(format!("{folder}: photos that are not in the model, and see none of its points: {unknown}"));
    }
    (capture.points, capture.colors) = (sparse::points(model), sparse::colors(model));
}

/// Gives the capture the points of a PLY file: the one that its transforms.json names, `sparse_pc.ply` or
/// `points3D.ply`.
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
