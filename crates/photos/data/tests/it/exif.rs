//! Photos with EXIF.

use image::metadata::Orientation;
use image::{DynamicImage, ImageEncoder, codecs::png::PngEncoder};
use std::fs;
use std::path::Path;

/// Stores a photo turned, with an EXIF tag that turns it upright again; with a focal length in millimeters.
pub fn store(path: &Path, orientation: Orientation, focal: Option<u16>) {
    let mut stored = DynamicImage::from(image::open(path).unwrap().into_rgb8());
    stored.apply_orientation(match orientation {
        Orientation::Rotate90 => Orientation::Rotate270,
        Orientation::Rotate270 => Orientation::Rotate90,
        same => same,
    });
    let mut exif = b"II*\0\x08\0\0\0".to_vec();
    // A directory with the orientation and a pointer, and behind it one with the focal length, where 0 is none.
    let directories: [&[[u16; 6]]; 2] = [
        &[[0x112, 3, 1, 0, orientation.to_exif().into(), 0], [0x8769, 4, 1, 0, 38, 0]],
        &[[0xa405, 3, 1, 0, focal.unwrap_or(0), 0]],
    ];
    for directory in directories {
        exif.extend((directory.len() as u16).to_le_bytes());
        directory.iter().flatten().for_each(|word| exif.extend(word.to_le_bytes()));
        exif.extend([0; 4]);
    }
    let mut encoder = PngEncoder::new(fs::File::create(path).unwrap());
    encoder.set_exif_metadata(exif).unwrap();
    encoder.write_image(stored.as_bytes(), stored.width(), stored.height(), stored.color().into()).unwrap();
}
