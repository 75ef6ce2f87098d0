//! Depth of photos that files know: `depth_file_path` of a capture's frames.

use crate::Error;
use rayon::prelude::*;
use std::path::Path;
use weaver_fit::KnownDepth;
use weaver_geometry::glam::DVec2;
use weaver_geometry::lens::{Lens, LensCamera};
use weaver_io::DepthPicture;
use weaver_scene::{Frame, Photo};

/// The entry of a frame that names its picture of depth, relative to the capture's folder.
const KEY: &str = "depth_file_path";

/// Longest side that depth is kept at, pixels: surfaces are smooth, and hundreds of photos take memory.
const LONG_SIDE: usize = 400;

/// Depth of the pinhole photos whose frames name a picture of it, by the number of the photo, for each pixel of the
/// photo as it is fitted, shrunk to 400 pixels. The picture has the shape of the photo's file, at any size.
///
/// # Errors
/// When a picture cannot be read, or has another shape.
pub(crate) fn of_files<'a>(
    capture: &Path,
    photos: &[Photo],
    frame: impl Fn(usize) -> &'a Frame + Sync,
) -> Result<Vec<(usize, KnownDepth)>, Error> {
    let folder = if capture.is_dir() { capture } else { capture.parent().unwrap_or(capture) };
    let named = |number: usize| {
        // Depth through a lens is along its rays.
        if photos[number].lens.is_some() {
            return None;
        }
        frame(number).extras.get(KEY).map(|entry| (number, entry))
    };
    let named: Vec<(usize, &String)> = (0..photos.len()).filter_map(named).collect();
    let read = |(number, entry): &(usize, &String)| {
        let name: String = serde_json::from_str(entry).map_err(|_| Error::Photos {
            capture: capture.to_path_buf(),
            key: KEY,
            expected: "the name of a file".into(),
            found: entry.to_string(),
        })?;
        Ok((*number, of_file(&folder.join(name), &photos[*number], frame(*number))?))
    };
    named.par_iter().map(read).collect()
}

fn of_file(path: &Path, photo: &Photo, frame: &Frame) -> Result<KnownDepth, Error> {
    let DepthPicture { width, height, depth } = DepthPicture::read(path)?;
    let file = &frame.camera;
    // A picture that is shrunk may be off by a pixel.
    let factor = file.width as f64 / width.max(1) as f64;
    if depth.is_empty() || (height as f64 * factor - file.height as f64).abs() > 1.0 + factor {
        return Err(Error::Photos {
            capture: path.to_path_buf(),
            key: KEY,
            expected: format!("the shape of the photo, {}x{}", file.width, file.height),
            found: format!("{width}x{height}"),
        });
    }
    let distorted = LensCamera::new(*file, Some(Lens::of(frame.distortion)));
    let camera = photo.camera.shrunk(LONG_SIDE);
    let (shown, rows, columns) = (LensCamera::new(camera, None), camera.height, camera.width);
    let scale = DVec2::new(width as f64 / file.width as f64, height as f64 / file.height as f64);
    let at = |pixel: usize| {
        let center = DVec2::new((pixel % columns) as f64 + 0.5, (pixel / columns) as f64 + 0.5);
        let (seen, _) = shown.point(center, 1.0).and_then(|point| distorted.see(point))?;
        let seen = seen * scale;
        let inside = seen.x >= 0.0 && seen.y >= 0.0 && seen.x < width as f64 && seen.y < height as f64;
        inside.then(|| depth[seen.y as usize * width + seen.x as usize])
    };
    Ok(KnownDepth { size: [rows, columns], depth: (0..rows * columns).map(|pixel| at(pixel).unwrap_or(0.0)).collect() })
}
