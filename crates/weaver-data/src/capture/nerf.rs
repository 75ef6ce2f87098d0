//! Captures described by `transforms.json` files.

use super::footage::{Footage, Shot};
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
pub(super) fn read(folder: &Path) -> Result<Footage, Error> {
    let path = folder.join("transforms.json");
    let transforms = Transforms::read(&path)?;
    let held_out = &transforms.test_filenames;
    if let Some(name) = held_out.iter().find(|&name| transforms.frames.iter().all(|f| f.name != *name)) {
        return Err(Error::unexpected(&path, "test_filenames", "the file_path of a frame", name.as_str()));
    }
    let mut footage = Footage {
        shots: transforms.frames.iter().map(|f| shot(f, held_out.contains(&f.name))).collect(),
        points: Vec::new(),
        split: !held_out.is_empty(),
    };
    if folder.join("sparse").exists() {
        let sparse_folder = sparse::folder(folder);
        let model = Model::read(&sparse_folder)?;
        add_points(&mut footage, &model, &sparse_folder)?;
    }
    Ok(footage)
}

/// `transforms_train.json` and `transforms_test.json`: transparent pixels become white, the test file is held out.
pub(super) fn read_split(folder: &Path) -> Result<Footage, Error> {
    let training = Transforms::read(folder.join("transforms_train.json"))?;
    let test = Transforms::read(folder.join("transforms_test.json"))?;
    let shots = training.frames.iter().map(|f| shot(f, false));
    let shots = shots.chain(test.frames.iter().map(|f| shot(f, true))).collect();
    Ok(Footage { shots, points: Vec::new(), split: true })
}

fn shot(frame: &Frame, held_out: bool) -> Shot {
    Shot { name: frame.name.clone(), file: frame.path.clone(), camera: frame.camera, held_out, track: Vec::new() }
}

/// Gives the shots the points that the model's images of the same name observe.
fn add_points(footage: &mut Footage, model: &Model, folder: &Path) -> Result<(), Error> {
    let extent = extent(footage.shots.iter().map(|shot| &shot.camera.pose));
    let index = sparse::index(model);
    for shot in &mut footage.shots {
        let Some(record) = model.images.iter().find(|record| shot.file.ends_with(&record.name)) else {
            continue;
        };
        let (ours, theirs) = (&shot.camera.pose, &record.pose);
        let moved = ours.center().distance(theirs.center());
        let turned = ours.angle_to(theirs);
        if turned > SAME_WORLD || moved > SAME_WORLD * extent {
            let found = format!("a camera turned by {turned:.3} rad and moved by {moved:.3}");
            return Err(Error::unexpected(folder, record.name.as_str(), "the pose in transforms.json", found));
        }
        shot.track = sparse::track(record, &index);
    }
    footage.points = sparse::points(model);
    Ok(())
}

/// Largest distance of a camera from the first.
fn extent<'a>(poses: impl Iterator<Item = &'a Pose>) -> f64 {
    let mut centers = poses.map(Pose::center);
    let Some(first) = centers.next() else { return 0.0 };
    centers.map(|c| c.distance(first)).fold(0.0, f64::max)
}
