//! The layout of D-NeRF: a `transforms.json` for training and one for tests, with times.

use super::roll::{Roll, Take, last_moment, moment};
use crate::Error;
use std::path::Path;
use weaver_io::Transforms;

pub(super) const TRAINING: &str = "transforms_train.json";
const TEST: &str = "transforms_test.json";

/// Transparent pixels are white; the test file is held out; the largest time of both becomes 1.
pub(super) fn read(folder: &Path) -> Result<Roll, Error> {
    let mut takes = Vec::new();
    for (name, test) in [(TRAINING, false), (TEST, true)] {
        let file = folder.join(name);
        for (i, frame) in Transforms::read(&file)?.frames.into_iter().enumerate() {
            let moment = moment(&file, &format!("frames[{i}].time"), frame.time)?;
            if let Some(distortion) = frame.distortion {
                let found = format!("{distortion:?}");
                return Err(Error::unexpected(&file, format!("frames[{i}]"), "a lens without distortion", found));
            }
            takes.push(Take { photo: frame.path, camera: frame.camera, moment, test });
        }
    }
    Ok(Roll {
        duration: last_moment(&takes),
        takes,
        points: Vec::new(),
        background: [1.0; 3],
        remarks: Vec::new(),
        clock: folder.join(TRAINING),
        usual_size: None,
    })
}
