//! Captures described by a RealEstate10K camera file.

use super::photo::{Photo, Photos};
use crate::Error;
use std::path::{Path, PathBuf};
use weaver_io::PhotoFile;
use weaver_io::realestate::Clip;
use weaver_scene::Frame;

/// The camera file of a folder: `cameras.txt`, or a clip's own name, 16 hexadecimal digits and `.txt`.
pub(super) fn camera_file(folder: &Path) -> Result<Option<PathBuf>, Error> {
    let is_clip = |path: &PathBuf| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        stem == "cameras" || (stem.len() == 16 && stem.bytes().all(|b| b.is_ascii_hexdigit()))
    };
    Ok(weaver_io::list_files(folder, &["txt"])?.into_iter().find(is_clip))
}

/// Frames in `images/`, or beside the camera file, named by their timestamps.
pub(super) fn read(folder: &Path, cameras: &Path) -> Result<Photos, Error> {
    let clip = Clip::read(cameras)?;
    let images = folder.join("images");
    let images = if images.is_dir() { images } else { folder.to_path_buf() };
    let photos = clip.frames.iter().map(|frame| {
        let name = frame.timestamp.to_string();
        let file = ["png", "jpg", "jpeg", "webp"]
            .map(|extension| images.join(format!("{name}.{extension}")))
            .into_iter()
            .find(|file| file.is_file())
            .ok_or_else(|| {
                let expected = format!("{name}.png, .jpg, .jpeg or .webp in {}", images.display());
                Error::unexpected(cameras, format!("frame {name}"), expected, "no such file")
            })?;
        // The file gives intrinsics as fractions of the image's size, so that they fit any. Photos that cannot be read
        // are reported together when they are loaded.
        let (width, height) = PhotoFile::at(&file).map_or((1, 1), |photo| photo.stored_size());
        let frame = Frame { path: file, ..frame.sized(width, height) };
        Ok(Photo { frame, held_out: false, track: Vec::new() })
    });
    Ok(Photos { photos: photos.collect::<Result<_, Error>>()?, ..Photos::default() })
}
