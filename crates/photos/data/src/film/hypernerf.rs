//! The layout of HyperNeRF, shared by Nerfies.

use super::roll::{Roll, Take, last_moment, moment};
use super::shots::FilmPoint;
use crate::Error;
use std::path::Path;
use weaver_io::nerfies::Capture;

pub(super) const SPLIT: &str = "dataset.json";
/// Folders of photos, the first there is: half the full size, as in the publication, full size, a quarter.
const SIZES: [&str; 3] = ["2x", "1x", "4x"];

/// Validation photos are held out; the largest time becomes 1.
pub(super) fn read(folder: &Path) -> Result<Roll, Error> {
    let capture = Capture::read(folder)?;
    let photos = folder.join("rgb");
    let Some(size) = SIZES.into_iter().find(|size| photos.join(size).is_dir()) else {
        return Err(Error::unexpected(&photos, "photos", "a folder 2x, 1x or 4x", "none of them"));
    };
    let clock = folder.join("metadata.json");
    let mut takes = Vec::with_capacity(capture.frames.len());
    for frame in &capture.frames {
        let photo = photos.join(size).join(format!("{}.png", frame.id));
        let moment = moment(&clock, &frame.id, Some(frame.moment))?;
        takes.push(Take { photo, camera: frame.camera, moment, test: frame.validation });
    }
    let mut remarks = vec![format!("{}: photos are those in rgb/{size}", folder.display())];
    if capture.unused > 0 {
        let file = folder.join(SPLIT);
        remarks.push(format!("{}: {} ids are neither in train_ids nor in val_ids", file.display(), capture.unused));
    }
    let positions = capture.points(folder)?.unwrap_or_default();
    if !positions.is_empty() {
        remarks.push(format!("{}: points have no colors: gray", folder.join("points.npy").display()));
    }
    let points = positions.into_iter().map(|position| FilmPoint { position, color: [0.5; 3], time: 0.0 }).collect();
    let (duration, background) = (last_moment(&takes), [0.0; 3]);
    Ok(Roll { takes, points, background, remarks, clock, duration, usual_size: None })
}
