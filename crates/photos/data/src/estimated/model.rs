//! Cameras and points as files have them: of the photos in their own size.

use super::EstimatedPhotos;
use super::masks::PhotoMask;
use crate::Error;
use crate::capture::MASKS;
use crate::spheres::Face;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use weaver_geometry::Camera;
use weaver_geometry::glam::DVec2;
use weaver_io::colmap::{Model, Point};
use weaver_io::{Bitmap, relative_path};
use weaver_scene::Frame;

/// The folder of photos that are written because of their EXIF orientation alone.
pub(super) const UPRIGHT: &str = "upright";

impl EstimatedPhotos {
    /// The photos with a camera by number, with cameras of the files, named relative to the folder of the capture.
    pub(super) fn frames(&self, folder: &Path) -> Result<Vec<(usize, Frame)>, Error> {
        let mut taken = BTreeSet::new();
        let mut frames = Vec::new();
        for (number, camera) in self.estimate.cameras.iter().enumerate() {
            let Ok(camera) = *camera else { continue };
            let (width, height) = self.sizes[number];
            let (sx, sy) = (width as f64 / camera.width as f64, height as f64 / camera.height as f64);
            let camera = Camera { intrinsics: camera.intrinsics.resized(sx, sy), width, height, ..camera };
            let path = std::path::absolute(&self.paths[number]).unwrap_or_else(|_| self.paths[number].clone());
            let mut copy = |to: &str| {
                let mut name = written(to, &path);
                if !taken.insert(name.to_lowercase()) {
                    name = name.replacen('/', &format!("/{number:04}-"), 1);
                }
                name
            };
            let mask = match &self.masks[number] {
                Some(PhotoMask { inverted: true, .. }) => Some(copy(MASKS)),
                Some(PhotoMask { file, .. }) => Some(relative_path(folder, file)?),
                None => None,
            };
            let upright = self.written_to(number).map(copy);
            let (name, path) = match upright {
                None => (relative_path(folder, &path)?, path),
                Some(name) => (name.clone(), folder.join(name)),
            };
            let (mask, distortion) = (mask.map(Into::into), self.estimate.distortion[number]);
            let extras = match &self.faces[number] {
                Some(Face { panorama, side, .. }) => {
                    let panorama = std::path::absolute(panorama).unwrap_or_else(|_| panorama.clone());
                    let text = |text: &str| serde_json::Value::from(text).to_string();
                    let panorama = ("panorama".into(), text(&relative_path(folder, &panorama)?));
                    BTreeMap::from([panorama, ("face".into(), text(side))])
                }
                None => BTreeMap::new(),
            };
            let taken_as = self.faces[number].as_ref().map_or(&self.paths[number], |face| &face.panorama);
            let time = self.times.get(taken_as).copied();
            frames.push((number, Frame { path, mask, distortion, time, extras, ..Frame::new(name, camera) }));
        }
        Ok(frames)
    }

    /// The folder in the capture's that a photo is written to, upright; `None` if its size shows every reader that it
    /// has to be turned.
    pub(super) fn written_to(&self, number: usize) -> Option<&'static str> {
        self.ambiguous[number].then_some(UPRIGHT)
    }

    /// The model of COLMAP, with points and tracks.
    pub(super) fn model(&self, frames: &[(usize, Frame)]) -> Model {
        let e = &self.estimate;
        let mut model = Model::from_frames(&frames.iter().map(|(_, frame)| frame.clone()).collect::<Vec<_>>());
        let place = |number: usize| frames.iter().position(|(n, _)| *n == number);
        for (id, group) in e.observations.chunk_by(|a, b| a.point == b.point).enumerate() {
            let (mut track, mut errors, mut rgb) = (Vec::new(), 0.0, None);
            for o in group {
                let (Some(at), Some(off)) = (place(o.camera), self.off(o)) else { continue };
                let pixel = o.pixel;
                let scale = self.sizes[o.camera].0 as f64 / self.images[o.camera].width as f64;
                let image = &mut model.images[at];
                track.push((image.id, image.points.len() as u32));
                image.points.push((pixel.x * scale, pixel.y * scale, Some(id as u64 + 1)));
                errors += scale * off;
                rgb = rgb.or_else(|| color(&self.images[o.camera], o.pixel));
            }
            let error = errors / track.len().max(1) as f64;
            let xyz = e.points[group[0].point].to_array();
            model.points.push(Point { id: id as u64 + 1, xyz, rgb: rgb.unwrap_or_default(), error, track });
        }
        model
    }
}

/// The color at a pixel of a photo.
fn color(photo: &Bitmap, pixel: DVec2) -> Option<[u8; 3]> {
    let (x, y) = ((pixel.x as usize).min(photo.width - 1), (pixel.y as usize).min(photo.height - 1));
    let at = 3 * (y * photo.width + x);
    photo.pixels.get(at..at + 3)?.try_into().ok()
}

/// Name of a photo in a folder of those that are written.
pub(super) fn written(images: &str, path: &Path) -> String {
    format!("{images}/{}.png", path.file_stem().unwrap_or_default().to_string_lossy())
}
