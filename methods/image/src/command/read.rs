//! Pictures from files, with notes on properties that a fit cannot keep.

use crate::{ImageError, Picture};
use std::path::Path;
use weaver_command::{Console, Failure, memory};
use weaver_io::PhotoFile;

/// Bytes of memory of a fit for a pixel: the picture in several forms, sums for its quadtree, values of tiles.
const FIT_BYTES: u64 = 100;
/// Most pixels of a picture, and of a drawing.
pub const MOST_PIXELS: usize = 1 << 28;
/// Sides below this are hardly smaller than a PNG.
const SMALL: usize = 16;

/// The picture in a file, over black; prints notes on changes of transparency, depth and gray.
pub fn read(path: &Path, console: &mut Console) -> Result<Picture, Failure> {
    let name = path.display();
    let file = PhotoFile::at(path)?.over([0.0; 3]);
    let (width, height) = file.size();
    if width.checked_mul(height).is_none_or(|pixels| pixels > MOST_PIXELS) {
        return Err(Failure::message(format!(
            "{name}: expected at most {MOST_PIXELS} pixels, found {width} x {height}"
        )));
    }
    memory::check(width as u64 * height as u64 * FIT_BYTES, "a smaller picture takes less")?;
    let image = file.read()?.to_image();
    if file.was_transparent() {
        console.note(&format!("{name}: transparent parts are black in the result"));
    }
    if file.bits() != 8 {
        console.note(&format!("{name}: numbers of {} bits are taken to 8", file.bits()));
    }
    if file.is_gray() {
        console.note(&format!("{name}: gray, fitted as three equal channels"));
    }
    if width.min(height) < SMALL {
        console.note(&format!("{name}: {width} x {height} pixels: a PNG is hardly larger"));
    }
    Picture::new(width, height, image.pixels).map_err(|error| failure(path, &error))
}

/// Prints notes if fewer Gaussians were fitted than wanted, or some were reset.
pub fn note_shortfall(path: &Path, asked: usize, found: usize, reset: usize, console: &mut Console) {
    let name = path.display();
    if found < asked {
        console.note(&format!("{name}: {found} Gaussians in place of {asked}: there is no more to show"));
    }
    if reset > 0 {
        console.note(&format!("{name}: Gaussians that left the numbers and were reset: {reset}"));
    }
}

/// A failure that names the file.
pub fn failure(path: &Path, error: &ImageError) -> Failure {
    Failure::message(format!("{}: {error}", path.display()))
}
