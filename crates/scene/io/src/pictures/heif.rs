//! HEIC and AVIF: photos in the HEIF container (ISO/IEC 23008-12), whose pixels another program decodes.

mod boxes;

use crate::files::file::{read_bytes, read_part};
use crate::pictures::exif::{exif_of_focal, focal_35mm};
use crate::pictures::photo_file::decoding::{Decoded, decode_bytes, heif_kind};
use crate::pictures::photo_file::orientation;
use crate::{Bitmap, Error, Result};
use boxes::Properties;
use image::codecs::jpeg::JpegEncoder;
use image::metadata::Orientation;
use image::{ExtendedColorType, ImageEncoder, ImageResult};
use std::path::{Path, PathBuf};

/// Everything of a HEIC or an AVIF photo but its pixels.
///
/// The container says which way up the photo is. Programs that decode it turn its pixels, or write this down, or
/// neither; EXIF in the container repeats it and does not count.
#[derive(Clone, Debug)]
pub struct HeifPhoto {
    path: PathBuf,
    kind: &'static str,
    /// Width and height of the pixels before they are turned.
    stored: (usize, usize),
    orientation: Orientation,
    /// ICC profile of its colors.
    profile: Option<Vec<u8>>,
}

/// Rotation of a photo by a program that decodes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turned {
    /// It turns the pixels.
    Always,
    /// It writes the pixels as they are stored.
    Never,
    /// It turns the pixels, or says in EXIF how to.
    AsTagged,
}

impl HeifPhoto {
    /// True if a file begins as such a photo does, under any name.
    pub fn is_at(path: impl AsRef<Path>) -> bool {
        read_part(path, 0..12).is_ok_and(|start| heif_kind(&start).is_some())
    }

    /// Reads the container of a photo.
    ///
    /// # Errors
    /// When the file cannot be read, or is no photo in such a container.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let bytes = read_bytes(path)?;
        let found = heif_kind(&bytes).zip(Properties::of_primary(&bytes)).filter(|(_, found)| found.size().0 > 0);
        let Some((kind, properties)) = found else {
            let expected = "a HEIC or AVIF photo with a size";
            return Err(Error::invalid(path, "container", expected, "none that can be read; was it copied whole?"));
        };
        let (stored, orientation, profile) = (properties.size(), properties.orientation, properties.profile());
        Ok(Self { path: path.to_path_buf(), kind, stored, orientation, profile })
    }

    /// The name of the format, HEIC or AVIF.
    pub fn kind(&self) -> &'static str {
        self.kind
    }

    /// Width and height of the upright photo.
    pub fn size(&self) -> (usize, usize) {
        orientation::turned(self.orientation, self.stored)
    }

    /// The upright photo in sRGB, from a file of another format that a program decoded it to. Its colors have the
    /// profile in that file, else the container's.
    ///
    /// # Errors
    /// When the file cannot be read, or has another size than the photo: some programs decode one tile of many.
    pub fn decoded(&self, file: impl AsRef<Path>, turned: Turned) -> Result<Bitmap> {
        let bytes = read_bytes(file)?;
        let (pixels, tagged) = decode_bytes(&self.path, &bytes, self.profile.as_deref())?;
        let (found, size) = (pixels.whole, self.size());
        let orientation = match turned {
            _ if found != size && found != self.stored => {
                let expected = format!("{}x{} as in its container", size.0, size.1);
                let found = format!("{}x{}, perhaps a tile of it", found.0, found.1);
                return Err(Error::invalid(&self.path, "decoded size", expected, found));
            }
            // Only one of both has the size, which tells more than a program's documentation.
            _ if size != self.stored && found == size => Orientation::NoTransforms,
            _ if size != self.stored => self.orientation,
            Turned::Always => Orientation::NoTransforms,
            Turned::Never => self.orientation,
            Turned::AsTagged => tagged,
        };
        let decoded = Decoded::over([1.0; 3], pixels, orientation);
        let (width, height) = decoded.size();
        Ok(Bitmap { width, height, pixels: decoded.into_pixels() })
    }

    /// A JPEG of the decoded photo, of a quality from 1 to 100, with the focal length in the photo's EXIF.
    ///
    /// # Errors
    /// When the photo cannot be read, or the picture has no pixels or too many.
    pub fn to_jpeg(&self, decoded: &Bitmap, quality: u8) -> Result<Vec<u8>> {
        let exif = focal_35mm(&self.path)?.and_then(exif_of_focal);
        let encode = || -> ImageResult<Vec<u8>> {
            let mut bytes = Vec::new();
            let mut encoder = JpegEncoder::new_with_quality(&mut bytes, quality);
            if let Some(exif) = exif {
                encoder.set_exif_metadata(exif).map_err(std::io::Error::other)?;
            }
            let (width, height) = (decoded.width as u32, decoded.height as u32);
            encoder.encode(&decoded.pixels, width, height, ExtendedColorType::Rgb8)?;
            Ok(bytes)
        };
        encode().map_err(|error| Error::invalid(&self.path, "image", "pixels that fit a JPEG", error))
    }
}
