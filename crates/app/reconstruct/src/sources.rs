//! The inputs of a run, recognized by their content.

use crate::Error;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use weaver_data::posed::{PosedPhoto, PosedPhotos};
use weaver_io::Checksum;

/// Checksums of photos with their masks, of their cameras, and of the points, as they were loaded.
///
/// The content of the inputs decides the bits, not their place: a capture may have been moved, but not changed.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[serde(transparent)]
pub(crate) struct Sources(BTreeMap<String, String>);

impl Sources {
    pub fn of(capture: &PosedPhotos) -> Self {
        let mut all = BTreeMap::new();
        for (number, photo) in capture.photos.iter().enumerate() {
            // Two photos may have one name.
            let name = format!("{number:04} {}", photo.frame.path.file_name().unwrap_or_default().to_string_lossy());
            all.insert(format!("photo {name}"), pixels(photo).to_string());
            all.insert(format!("camera of {name}"), camera(photo).to_string());
        }
        let mut points = Checksum::default();
        points.floats(capture.points.positions.as_flattened());
        points.bytes(capture.points.colors.as_flattened());
        all.insert("points".into(), points.to_string());
        Self(all)
    }

    /// Checks that a resumed run has read the same inputs as it `began` with. A run without checksums passes.
    ///
    /// # Errors
    /// When inputs differ; names the first photo or camera that does, or the points.
    pub fn check(&self, began: &Self, capture: &Path, run: &Path) -> Result<(), Error> {
        if began.0.is_empty() {
            return Ok(());
        }
        let Some(key) = began.0.keys().chain(self.0.keys()).find(|key| began.0.get(*key) != self.0.get(*key)) else {
            return Ok(());
        };
        let found = match (began.0.contains_key(key), self.0.contains_key(key)) {
            (true, true) => "another",
            (true, false) => "none",
            _ => "one more",
        };
        Err(Error::Changed {
            capture: capture.into(),
            key: key.clone(),
            expected: format!("what the fit began with ({})", run.display()),
            found: found.into(),
        })
    }
}

fn pixels(photo: &PosedPhoto) -> Checksum {
    let mut sum = Checksum::default();
    sum.bytes(&photo.photo.rgb);
    // The mask as bytes, 255 where a pixel counts.
    let mask = photo.photo.mask.iter().flatten().map(|counts| if *counts { 255 } else { 0 });
    sum.bytes(&mask.collect::<Vec<u8>>());
    sum
}

fn camera(photo: &PosedPhoto) -> Checksum {
    let mut sum = Checksum::default();
    let camera = &photo.photo.camera;
    let pose = camera.pose.rotation.to_cols_array().into_iter().chain(camera.pose.translation.to_array());
    let k = &camera.intrinsics;
    pose.chain([k.fx, k.fy, k.cx, k.cy]).for_each(|x| sum.word(x.to_bits()));
    [camera.width, camera.height, usize::from(photo.held_out)].iter().for_each(|x| sum.word(*x as u64));
    sum
}
