//! The training views of methods, and the judging ones.

use super::settings::Settings;
use weaver_command::Failure;
use weaver_command::camera_files::{self, Size};
use weaver_data::posed::{self, PosedOptions};
use weaver_geometry::Camera;
use weaver_io::Checksum;
use weaver_scene::{Gaussians, Photo};

/// Judging pictures of an orbit, training pictures beside each, and their side.
const ORBIT: (usize, usize, usize) = (6, 3, 256);
/// Stride of the judging cameras.
const JUDGES: usize = 8;
/// Longest side of pictures from cameras of a file, and of photos.
const LONG_SIDE: usize = 384;

/// Views of a scene: for training, and for judging.
#[derive(Default)]
pub struct Views {
    pub training: Vec<Camera>,
    pub judging: Vec<Camera>,
    /// Photos of the training cameras, and of the judging ones; none without a capture.
    pub photos: [Vec<Photo>; 2],
}

impl Views {
    /// Adds cameras and photos to a checksum.
    pub fn add_to(&self, sum: &mut Checksum) {
        for camera in self.training.iter().chain(&self.judging) {
            let (pose, k) = (&camera.pose, &camera.intrinsics);
            let numbers = pose.rotation.to_cols_array().into_iter().chain(pose.translation.to_array());
            numbers.chain([k.fx, k.fy, k.cx, k.cy]).for_each(|x| sum.word(x.to_bits()));
            [camera.width, camera.height].iter().for_each(|x| sum.word(*x as u64));
        }
        self.photos.iter().flatten().for_each(|photo| sum.bytes(&photo.rgb));
    }
}

/// The views of the capture, of the file of cameras, or of an orbit.
pub fn views(settings: &Settings, gaussians: &Gaussians) -> Result<Views, Failure> {
    let mut views = Views::default();
    if let Some(data) = &settings.data {
        let options = PosedOptions { long_side: Some(LONG_SIDE), background: [1.0; 3], ..PosedOptions::default() };
        for posed in posed::load(data, &options)?.photos.into_iter().filter(|posed| !posed.photo.is_masked()) {
            views.photos[usize::from(posed.held_out)].push(posed.photo);
        }
        if views.photos[1].is_empty() {
            let found = "none held out";
            return Err(Failure::message(format!(
                "{}: expected photos that are held out, found {found}",
                data.display()
            )));
        }
        let cameras = |photos: &[Photo]| photos.iter().map(|photo| photo.camera).collect();
        (views.training, views.judging) = (cameras(&views.photos[0]), cameras(&views.photos[1]));
        return Ok(views);
    }
    let (every, all) = match &settings.cameras {
        Some(file) => {
            let frames = camera_files::read(file, Size::default())?;
            (JUDGES, frames.iter().map(|frame| frame.camera.shrunk(LONG_SIDE)).collect::<Vec<_>>())
        }
        None => {
            let (judges, others, side) = ORBIT;
            (1 + others, weaver_scene::orbit(gaussians, judges * (1 + others), [side; 2]).unwrap_or_default())
        }
    };
    for (i, camera) in all.iter().enumerate() {
        let place = if i % every == 0 { &mut views.judging } else { &mut views.training };
        place.push(*camera);
    }
    if views.training.is_empty() {
        // A single camera serves both purposes.
        views.training.clone_from(&views.judging);
    }
    Ok(views)
}
