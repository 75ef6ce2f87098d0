//! Photos that come with the program, for a first look.

use std::path::PathBuf;
use weaver_io::{OutputFolder, atomic_write};

/// Folder of the photos inside the folder of results.
const FOLDER: &str = "photos";

/// The photos by their names in `demo/`.
macro_rules! photos {
    ($($name:literal)+) => {
        [$(($name, include_bytes!(concat!("../demo/", $name)).as_slice()),)+]
    };
}

/// Photos of bananas on a table, 384 x 255 pixels. Their license is beside them.
pub const PHOTOS: [(&str, &[u8]); 14] = photos!(
    "DSC_0423.jpg" "DSC_0424.jpg" "DSC_0425.jpg" "DSC_0426.jpg" "DSC_0427.jpg" "DSC_0428.jpg" "DSC_0430.jpg"
    "DSC_0431.jpg" "DSC_0432.jpg" "DSC_0433.jpg" "DSC_0435.jpg" "DSC_0436.jpg" "DSC_0437.jpg" "DSC_0438.jpg"
);
/// Their license.
const LICENSE: (&str, &[u8]) = ("LICENSE.txt", include_bytes!("../demo/LICENSE.txt"));

/// Writes the photos into a folder of results, and returns the path of the folder that holds them.
///
/// # Errors
/// When they cannot be written.
pub fn write(out: &OutputFolder) -> Result<PathBuf, weaver_io::Error> {
    for (name, bytes) in PHOTOS.into_iter().chain([LICENSE]) {
        atomic_write(out.file(format!("{FOLDER}/{name}"))?, |file| file.write_all(bytes))?;
    }
    Ok(out.path().join(FOLDER))
}
