//! The layout of Neural 3D Video: a folder of frames for each camera, which are calibrated in `poses_bounds.npy`.

use super::roll::{Roll, Take};
use crate::Error;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use weaver_io::{ShellCommand, list_files, list_folders, list_photos, llff};

pub(super) const CAMERAS: &str = "poses_bounds.npy";
/// Prefix of the names of cameras.
const PREFIX: &str = "cam";

/// The first camera by name is held out; frame f of F has the time f / F; photos have half the size of the calibration.
pub(super) fn read(folder: &Path) -> Result<Roll, Error> {
    let file = folder.join(CAMERAS);
    let calibrated = llff::read_poses_bounds(&file)?;
    let names = names(folder)?;
    if names.len() != calibrated.len() {
        let expected = format!("[{}, 17] for {}", names.len(), listed(&names));
        return Err(Error::unexpected(&file, "shape", expected, format!("[{}, 17]", calibrated.len())));
    }
    if names.len() < 2 {
        return Err(Error::unexpected(folder, "cameras", "at least two", listed(&names)));
    }
    let frames: Vec<Vec<PathBuf>> = names.iter().map(|name| frames(folder, name, &names)).collect::<Result<_, _>>()?;
    let count = frames[0].len();
    if count < 2 {
        return Err(Error::unexpected(&folder.join(&names[0]), "frames", "at least two", count.to_string()));
    }
    let other = frames.iter().position(|frames| frames.len() != count);
    if let Some(i) = other {
        let expected = format!("{count}, as many as of {}", names[0]);
        return Err(Error::unexpected(&folder.join(&names[i]), "frames", expected, frames[i].len().to_string()));
    }
    let usual = calibrated.iter().map(|bounded| bounded.camera.width.max(bounded.camera.height) / 2).max();
    let mut takes = Vec::with_capacity(count * names.len());
    for (i, (frames, bounded)) in frames.into_iter().zip(&calibrated).enumerate() {
        let take = |(f, photo)| Take { photo, camera: bounded.camera, moment: f as f64, test: i == 0 };
        takes.extend(frames.into_iter().enumerate().map(take));
    }
    Ok(Roll {
        takes,
        points: Vec::new(),
        background: [0.0; 3],
        remarks: Vec::new(),
        clock: folder.to_path_buf(),
        duration: count as f64,
        usual_size: usual.map(|side| side.max(1)),
    })
}

/// The cameras that have a video or a folder, sorted.
fn names(folder: &Path) -> Result<Vec<String>, Error> {
    let videos = list_files(folder, &["mp4"])?;
    let stems = videos.iter().filter_map(|path| path.file_stem());
    let folders = list_folders(folder)?;
    let all = stems.chain(folders.iter().filter_map(|path| path.file_name()));
    let names: BTreeSet<String> =
        all.map(|name| name.to_string_lossy().into_owned()).filter(|name| name.starts_with(PREFIX)).collect();
    Ok(names.into_iter().collect())
}

/// The frames of a camera in the order of their numbers.
fn frames(folder: &Path, name: &str, names: &[String]) -> Result<Vec<PathBuf>, Error> {
    let camera = folder.join(name);
    for place in [camera.clone(), camera.join("images")].iter().filter(|place| place.is_dir()) {
        let photos = list_photos(place)?;
        if !photos.is_empty() {
            return Ok(photos);
        }
    }
    let video = camera.with_extension("mp4");
    if !video.is_file() {
        return Err(Error::unexpected(&camera, "frames", "photos in it or in its folder images", "none"));
    }
    let make = ShellCommand::new("mkdir -p").path(&camera);
    let cut = ShellCommand::new("ffmpeg -i").path(&video).path(camera.join("%04d.png"));
    let others = match names.len() {
        0 | 1 => String::new(),
        n => format!("; likewise for the others of {n} cameras"),
    };
    let expected = format!("its frames as photos: `{make} && {cut}`{others}");
    Err(Error::unexpected(&video, "frames", expected, "a video alone"))
}

fn listed(names: &[String]) -> String {
    match names {
        [] => "no folder or video whose name begins with cam".into(),
        [one] => one.clone(),
        [first, .., last] => format!("{} cameras, {first} to {last}", names.len()),
    }
}
