//! Cameras of a capture and their visible points, without a pixel.

use super::masks;
use super::photo::straight_camera;
use super::visible::visible_points;
use super::{HoldOut, folder, read_split_photos};
use crate::Error;
use rayon::prelude::*;
use std::path::Path;
use weaver_geometry::Camera;
use weaver_geometry::geodesy::Origin;
use weaver_geometry::lens::LensCamera;
use weaver_scene::{Frame, PointCloud};

/// A photo of a capture before it is read.
#[derive(Clone, Debug, PartialEq)]
pub struct SurveyedPhoto {
    /// The image file: its path, its camera, and the capture's entries for it. The mask is a file that is there, if
    /// masks were requested.
    pub frame: Frame,
    /// Its camera without distortion.
    pub camera: Camera,
    /// Kept from training, for evaluation.
    pub held_out: bool,
    /// Indices of the points that it sees, ascending ([`PosedPhoto::visible`](super::posed::PosedPhoto::visible)).
    pub visible: Vec<u32>,
}

/// The cameras of a capture, and its points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Survey {
    /// The photos in order of their paths.
    pub photos: Vec<SurveyedPhoto>,
    /// Points on surfaces; empty if the capture has none.
    pub points: PointCloud,
    /// The origin of the world, where the capture has one.
    pub origin: Option<Origin>,
    /// Remarks for the user about how the files were read.
    pub remarks: Vec<String>,
}

/// Reads the cameras and points of a capture, in any layout that [`capture::load`](super::load) takes, and finds the
/// photos that see each point.
///
/// # Errors
/// When a file of the capture is missing or malformed, a mask that is named is not there, or a distortion leaves no
/// photo.
pub fn survey(path: impl AsRef<Path>, hold_out: HoldOut, masks: bool) -> Result<Survey, Error> {
    let path = path.as_ref();
    let mut capture = read_split_photos(path, hold_out)?;
    if masks {
        let found = masks::of_capture(&capture.photos, folder(path))?;
        capture.photos.iter_mut().zip(found).for_each(|(photo, mask)| photo.frame.mask = mask.file);
    } else {
        capture.photos.iter_mut().for_each(|photo| photo.frame.mask = None);
    }
    let sees = |photo: &super::Photo| {
        let frame = photo.frame.clone();
        let camera = straight_camera(frame.camera, photo.lens(frame.camera)?.as_ref());
        let (visible, _) = visible_points(&LensCamera::new(camera, None), &capture, photo);
        Ok(SurveyedPhoto { frame, camera, held_out: photo.held_out, visible })
    };
    let photos = capture.photos.par_iter().map(sees).collect::<Result<_, Error>>()?;
    let positions = capture.points.iter().map(|p| p.as_vec3().to_array()).collect();
    let points = PointCloud { positions, colors: capture.colors };
    Ok(Survey { photos, points, origin: capture.origin, remarks: capture.remarks })
}
