//! Valid pixels of photos.

use super::features::{by_stem, refused, unmatched};
use super::sampling::Lens;
use std::path::Path;
use weaver_command::Failure;
use weaver_io::{Background, Image};

/// Extensions of mask pictures.
const EXTENSIONS: [&str; 6] = ["png", "jpg", "jpeg", "tif", "tiff", "webp"];

/// Valid pixels of each photo's camera image, from pictures of any size, white at valid places; `None` for a photo
/// without a picture.
pub fn read(folder: &Path, stems: &[String], lenses: &[Lens]) -> Result<Vec<Option<Vec<bool>>>, Failure> {
    let files = by_stem(folder, &EXTENSIONS)?;
    unmatched(folder, &files, stems)?;
    if files.is_empty() {
        return Err(refused(folder, "pictures that are white where photos count", "none"));
    }
    let read = |(stem, lens): (&String, &Lens)| {
        let Some(path) = files.get(stem) else { return Ok(None) };
        let picture = Image::read(path, Background::Black)?;
        let counts = |pixel| {
            let at = lens.nearest(pixel, [picture.height, picture.width]);
            picture.pixels[3 * at..3 * at + 3].iter().sum::<f32>() > 1.5
        };
        Ok(Some((0..lens.pixels()).map(counts).collect()))
    };
    stems.iter().zip(lenses).map(read).collect()
}
