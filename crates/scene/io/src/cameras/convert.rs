//! Cameras from one format to another, moved on the way.

use super::colmap::{CAMERA_ID, ImageRecord, Model, model_folder};
use super::project::{Project, ProjectKind};
use super::transforms::Transforms;
use crate::gaussians::SCENE_IN_FOLDER;
use crate::{Observe, OutputFolder, Result, relative_path};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weaver_geometry::Similarity;
use weaver_geometry::geodesy::{Geographic, Origin};
use weaver_geometry::glam::DVec3;
use weaver_scene::Frame;

const TRANSFORMS: &str = "transforms.json";
const SPARSE: &str = "sparse/0";

/// Cameras to convert.
struct Cameras {
    frames: Vec<Frame>,
    model: Model,
    origin: Option<Origin>,
    remarks: Vec<String>,
}

/// Cameras that were converted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConvertedCameras {
    /// Cameras, one for each photo.
    pub photos: usize,
    /// Points of the scene.
    pub points: usize,
    /// Origin of their world; `None` where the input has none, and of cameras that were moved.
    pub origin: Option<Origin>,
}

impl ConvertedCameras {
    /// The conversion of a file or folder to another as JSON.
    pub fn json(&self, from: &Path, to: &Path) -> Value {
        let origin = match self.origin {
            None => Value::Null,
            Some(Origin::Local { offset }) => json!({ "offset": offset }),
            Some(Origin::Geographic(Geographic { latitude, longitude, altitude })) => {
                json!({ "latitude": latitude, "longitude": longitude, "altitude": altitude })
            }
        };
        json!({
            "inputs": [from.display().to_string()],
            "output": to.display().to_string(),
            "photos": self.photos,
            "points": self.points,
            "origin": origin,
        })
    }
}

/// True for a file or folder of cameras, which [`convert_cameras`] reads.
pub fn is_cameras(path: &Path) -> bool {
    if path.is_dir() {
        let model = model_folder(path);
        let colmap = ["cameras.bin", "cameras.txt"].iter().any(|name| model.join(name).is_file());
        // Scenes of SOG are folders, too.
        return colmap || path.join(TRANSFORMS).is_file() || matches!(Project::find(path), Ok(Some(_)));
    }
    let named = path.file_name().is_some_and(|name| !SCENE_IN_FOLDER.iter().any(|scene| name == *scene))
        && path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    named || matches!(ProjectKind::of(path), Ok(Some(_)))
}

/// Writes cameras of Metashape, RealityScan, Bundler, OpenSfM, COLMAP or a transforms.json to a transforms.json, by its
/// name, or to a folder with one and a COLMAP model. Photos stay where they are; files name them relative to theirs.
///
/// # Errors
/// When a file cannot be read or written.
pub fn convert_cameras(
    from: &Path,
    to: &Path,
    moved: Option<Similarity>,
    observe: &mut dyn Observe,
) -> Result<ConvertedCameras> {
    let mut cameras = read(from)?;
    cameras.remarks.iter().for_each(|remark| observe.warning(remark));
    if let Some(moved) = moved {
        cameras.frames.iter_mut().for_each(|frame| frame.camera.pose = moved.apply_to_pose(&frame.camera.pose));
        cameras.model.points.iter_mut().for_each(|point| point.xyz = moved.apply(DVec3::from(point.xyz)).to_array());
        // Coordinates of another world have no place in the old one.
        cameras.origin = None;
    }
    let is_file = to.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    let folder = if is_file { to.parent().unwrap_or(Path::new("")) } else { to };
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    // Photos stay where they are, and both can be moved together.
    for frame in &mut cameras.frames {
        let mask = frame.mask.as_ref().map(|mask| relative_path(folder, mask)).transpose()?;
        (frame.name, frame.mask) = (relative_path(folder, &frame.path)?, mask.map(PathBuf::from));
        // Ids of COLMAP's cameras are those of the written model.
        frame.extras.remove(CAMERA_ID);
    }
    let Cameras { frames, model, origin, .. } = cameras;
    let (photos, points) = (frames.len(), model.points.len());
    let transforms = Transforms { frames, origin, ..Transforms::default() };
    if is_file {
        transforms.write(to)?;
    } else {
        let out = OutputFolder::claim(to, "convert", [from])?;
        let mut staged = out.staged()?;
        let named = Model::from_frames(&transforms.frames);
        let ids: BTreeMap<u32, u32> =
            model.images.iter().zip(&named.images).map(|(old, new)| (old.id, new.id)).collect();
        let mut points = model.points;
        for (image, _) in points.iter_mut().flat_map(|point| &mut point.track) {
            *image = ids.get(image).copied().unwrap_or(*image);
        }
        let images = named.images.into_iter().zip(model.images);
        let images = images.map(|(named, old)| ImageRecord { points: old.points, ..named }).collect();
        let model = Model { images, cameras: named.cameras, points };
        model.write_binary(staged.files(SPARSE, Model::FILES)?)?;
        transforms.write(staged.file(TRANSFORMS)?)?;
        staged.commit(&[&format!("{SPARSE}/images.bin"), TRANSFORMS])?;
    }
    Ok(ConvertedCameras { photos, points, origin })
}

fn read(from: &Path) -> Result<Cameras> {
    let project = if from.is_dir() { None } else { Some(from.to_path_buf()) };
    let is_model = |folder: &Path| ["cameras.bin", "cameras.txt"].iter().any(|name| folder.join(name).is_file());
    if project.is_none() {
        let model = model_folder(from);
        if is_model(&model) {
            return of_model(&model, from);
        }
    }
    let file = match project {
        Some(file) => file,
        None if from.join(TRANSFORMS).is_file() => from.join(TRANSFORMS),
        None => Project::find(from)?.unwrap_or_else(|| from.join(TRANSFORMS)),
    };
    if ProjectKind::of(&file)?.is_some() {
        let project = Project::read_cameras(&file)?;
        let model = project.to_model();
        let Project { frames, origin, remarks, .. } = project;
        return Ok(Cameras { frames, model, origin, remarks });
    }
    let transforms = Transforms::read_cameras(&file)?;
    let mut frames = transforms.frames;
    // Masks are named from the file's folder.
    let folder = file.parent().unwrap_or(Path::new(""));
    frames.iter_mut().filter_map(|frame| frame.mask.as_mut()).for_each(|mask| *mask = folder.join(&*mask));
    let model = Model::from_frames(&frames);
    Ok(Cameras { frames, model, origin: transforms.origin, remarks: Vec::new() })
}

/// A model of COLMAP, whose photos are in `images` of the capture, or in the capture.
fn of_model(folder: &Path, from: &Path) -> Result<Cameras> {
    let model = Model::read(folder)?;
    let mut frames = model.frames();
    let above = folder.ancestors().take(3).chain([from]);
    let places: Vec<PathBuf> = above.flat_map(|folder| [folder.join("images"), folder.to_path_buf()]).collect();
    for frame in &mut frames {
        let found = places.iter().map(|place| place.join(&frame.name)).find(|path| path.is_file());
        frame.path = found.unwrap_or_else(|| from.join("images").join(&frame.name));
    }
    let origin = Transforms::read_cameras(from.join(TRANSFORMS)).ok().and_then(|transforms| transforms.origin);
    Ok(Cameras { frames, model, origin, remarks: Vec::new() })
}
