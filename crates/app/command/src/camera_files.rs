//! Cameras from any of the supported files.

use crate::Failure;
use std::path::Path;
use weaver_geometry::{Camera, Undistortion};
use weaver_scene::Frame;

pub use weaver_scene::stems;

/// The requested image size; missing sides follow from the camera file.
#[derive(Clone, Copy, Debug, Default)]
pub struct Size {
    /// Pixels from left to right.
    pub width: Option<usize>,
    /// Pixels from top to bottom.
    pub height: Option<usize>,
}

impl Size {
    /// The camera with an image of this size; a missing side follows from the aspect ratio.
    fn apply(self, camera: Camera) -> Camera {
        let (w, h) = (camera.width as f64, camera.height as f64);
        let scaled = |side: usize, by: f64| ((side as f64 * by).round() as usize).max(1);
        let (width, height) = match (self.width, self.height) {
            (None, None) => return camera,
            (Some(width), Some(height)) => (width, height),
            (Some(width), None) => (width, scaled(width, h / w)),
            (None, Some(height)) => (scaled(height, w / h), height),
        };
        let intrinsics = camera.intrinsics.resized(width as f64 / w, height as f64 / h);
        Camera { intrinsics, width, height, ..camera }
    }
}

/// Reads the cameras of a transforms.json, of a folder with a COLMAP model, of another program's project, or of a
/// RealEstate10K file.
pub fn read(path: &Path, size: Size) -> Result<Vec<Frame>, Failure> {
    Ok(read_with_lenses(path, size)?.into_iter().map(|(frame, _)| frame).collect())
}

/// As [`read`], for pictures of another lens and size: only the poses and names are of use.
pub fn read_poses(path: &Path) -> Result<Vec<Frame>, Failure> {
    let frames = weaver_io::read_cameras(path)?;
    match frames.is_empty() {
        false => Ok(frames),
        true => Err(none_found(path)),
    }
}

fn none_found(path: &Path) -> Failure {
    Failure::message(format!("{}: expected at least one camera, found none", path.display()))
}

/// As [`read`], each camera with the distortion of its photo, if any; the cameras themselves are for undistorted
/// photos, as in captures.
pub fn read_with_lenses(path: &Path, size: Size) -> Result<Vec<(Frame, Option<Undistortion>)>, Failure> {
    let frames = weaver_io::read_cameras(path)?;
    if frames.is_empty() {
        return Err(none_found(path));
    }
    // Only these give intrinsics without a size: a transforms.json of 1 x 1 pixel says that its images have one.
    let is_realestate = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("txt"));
    if is_realestate && (size.width.is_none() || size.height.is_none()) {
        let found = "a RealEstate10K file, which does not tell the size of its images";
        return Err(Failure::Usage(format!("{}: expected --width and --height with {found}", path.display())));
    }
    let sized = |mut frame: Frame| {
        let lens = lens(&frame, path)?;
        frame.camera = size.apply(lens.map_or(frame.camera, |lens| lens.to));
        // The factor on the focal length does not depend on the size.
        let lens = lens.and_then(|lens| Undistortion::new(size.apply(lens.from), lens.distortion));
        Ok((frame, lens))
    };
    frames.into_iter().map(sized).collect()
}

/// Lens that undoes the distortion of a frame's photo.
fn lens(frame: &Frame, path: &Path) -> Result<Option<Undistortion>, Failure> {
    let Some(distortion) = frame.distortion else { return Ok(None) };
    let undone = Undistortion::new(frame.camera, distortion).ok_or_else(|| {
        let (path, name) = (path.display(), &frame.name);
        let expected = "expected a lens distortion that leaves a photo without blank borders";
        Failure::message(format!("{path}: {name}: {expected}, found {distortion:?}"))
    })?;
    Ok(Some(undone))
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::{Distortion, Intrinsics, Pose};
    use weaver_io::Transforms;

    fn camera() -> Camera {
        let intrinsics = Intrinsics { fx: 100.0, fy: 110.0, cx: 40.0, cy: 30.0 };
        Camera { pose: Pose::IDENTITY, intrinsics, width: 80, height: 60 }
    }

    #[test]
    fn a_missing_side_follows_from_the_other() {
        let wide = Size { width: Some(160), height: None }.apply(camera());
        assert_eq!((wide.width, wide.height, wide.intrinsics.fy, wide.intrinsics.cx), (160, 120, 220.0, 80.0));
        let low = Size { width: None, height: Some(30) }.apply(camera());
        assert_eq!((low.width, low.height, low.intrinsics.fx), (40, 30, 50.0));
        assert_eq!(Size::default().apply(camera()), camera());
    }

    #[test]
    fn a_distorted_photo_is_drawn_as_it_is_loaded() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("transforms.json");
        let write = |k1: f64| {
            let frame = Frame { distortion: Some(Distortion::radial(k1)), ..Frame::new("a.png", camera()) };
            Transforms { frames: vec![frame], ..Transforms::default() }.write(&path).unwrap();
        };
        write(-0.1);
        let read = super::read(&path, Size { width: Some(160), height: None }).unwrap();
        let undone = Undistortion::new(camera(), Distortion::radial(-0.1)).unwrap().to.intrinsics;
        assert!((read[0].camera.intrinsics.fx - 2.0 * undone.fx).abs() < 1e-9 && undone.fx != 100.0);
        write(-50.0);
        let message = format!("{:?}", super::read(&path, Size::default()).unwrap_err());
        assert!(message.contains("a.png: expected a lens distortion"), "{message}");
    }
}
