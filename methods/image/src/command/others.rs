//! The same pictures by other codecs: quality at equal bytes.

use crate::{Picture, metrics};
use std::path::{Path, PathBuf};
use weaver_command::Failure;
use weaver_io::{Background, Bitmap, Image, PhotoFile, file_length, list_photos};

/// Name of the program's own encoder.
pub const OWN: &str = "JPEG, own";
/// Qualities of the program's own encoder.
const QUALITIES: [u8; 12] = [1, 3, 6, 10, 15, 22, 30, 40, 50, 60, 70, 80];

/// A picture by a codec, at several lengths.
pub struct Codec {
    pub name: String,
    /// In order of bytes.
    pub files: Vec<Encoded>,
}

/// A picture by a codec.
pub struct Encoded {
    pub bytes: usize,
    pub psnr: f64,
    pub ms_ssim: Option<f64>,
    pixels: Pixels,
}

enum Pixels {
    File(PathBuf),
    Memory(Vec<u8>),
}

impl Encoded {
    fn new(picture: &Picture, bytes: usize, pixels: Pixels) -> Result<Self, Failure> {
        let mut this = Self { bytes, psnr: 0.0, ms_ssim: None, pixels };
        let image = this.image()?;
        let size = [picture.height(), picture.width()];
        if [image.height, image.width] != size {
            let Pixels::File(path) = &this.pixels else { unreachable!("an encoder keeps the size") };
            let (found, path) = ([image.width, image.height], path.display());
            let expected = [size[1], size[0]];
            return Err(Failure::message(format!(
                "{path}: expected the picture's {expected:?} pixels, found {found:?}"
            )));
        }
        this.psnr = metrics::psnr(&image.pixels, picture.colors());
        this.ms_ssim = metrics::ms_ssim(&image.pixels, picture.colors(), size);
        Ok(this)
    }

    /// The decoded picture.
    pub fn image(&self) -> Result<Image, Failure> {
        match &self.pixels {
            Pixels::File(path) => Ok(PhotoFile::at(path)?.read()?.to_image()),
            Pixels::Memory(bytes) => Ok(Image::decode(bytes, "a JPEG in memory", Background::Black)?),
        }
    }
}

impl Codec {
    /// Decibels at a number of bytes, interpolated between files; none beyond them.
    pub fn psnr(&self, bytes: usize) -> Option<f64> {
        self.between(bytes, |file| Some(file.psnr))
    }

    /// Multi-scale structural similarity at a number of bytes.
    pub fn ms_ssim(&self, bytes: usize) -> Option<f64> {
        self.between(bytes, |file| file.ms_ssim)
    }

    fn between(&self, bytes: usize, of: impl Fn(&Encoded) -> Option<f64>) -> Option<f64> {
        let after = self.files.iter().position(|file| file.bytes >= bytes)?;
        let high = &self.files[after];
        if high.bytes == bytes {
            return of(high);
        }
        let low = &self.files[after.checked_sub(1)?];
        let log = |file: &Encoded| (file.bytes as f64).ln();
        let part = ((bytes as f64).ln() - log(low)) / (log(high) - log(low));
        Some(of(low)? + part * (of(high)? - of(low)?))
    }

    /// The longest file of at most `bytes` bytes.
    pub fn within(&self, bytes: usize) -> Option<&Encoded> {
        self.files.iter().rev().find(|file| file.bytes <= bytes)
    }
}

/// The codecs of a picture: from the files in a folder, or else the program's own encoder.
pub fn codecs(path: &Path, picture: &Picture, folder: Option<&Path>) -> Result<Vec<Codec>, Failure> {
    let mut codecs: Vec<Codec> = Vec::new();
    let mut add = |name: &str, encoded: Encoded| match codecs.iter_mut().find(|codec| codec.name == name) {
        Some(codec) => codec.files.push(encoded),
        None => codecs.push(Codec { name: name.into(), files: vec![encoded] }),
    };
    if let Some(folder) = folder {
        let stem = format!("{}-", path.file_stem().unwrap_or_default().to_string_lossy());
        for file in list_photos(folder)? {
            let own = file.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&stem));
            let kind = file.extension().map(|kind| kind.to_string_lossy().to_lowercase()).unwrap_or_default();
            let (name, pixels) = match kind.as_str() {
                _ if !own => continue,
                "jpg" | "jpeg" => ("JPEG", file.clone()),
                "webp" => ("WebP", file.clone()),
                "avif" => ("AVIF", file.with_extension("avif.png")),
                _ => continue,
            };
            let bytes = file_length(&file)? as usize;
            add(name, Encoded::new(picture, bytes, Pixels::File(pixels))?);
        }
    } else {
        let (width, height) = (picture.width(), picture.height());
        let image = Image { width, height, pixels: picture.colors().to_vec() };
        let bitmap = Bitmap { width, height, pixels: image.to_bytes() };
        for quality in QUALITIES {
            let bytes = bitmap.to_jpeg(quality)?;
            add(OWN, Encoded::new(picture, bytes.len(), Pixels::Memory(bytes))?);
        }
    }
    codecs.sort_by(|a, b| a.name.cmp(&b.name));
    for codec in &mut codecs {
        codec.files.sort_by_key(|file| file.bytes);
        codec.files.dedup_by_key(|file| file.bytes);
    }
    Ok(codecs)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_bytes_lie_between_files_and_not_beyond() {
        let file = |bytes, psnr| Encoded { bytes, psnr, ms_ssim: None, pixels: Pixels::Memory(Vec::new()) };
        let codec = Codec { name: "X".into(), files: vec![file(100, 20.0), file(400, 24.0)] };
        assert_eq!(codec.psnr(200).map(|x| (1e9 * x).round() / 1e9), Some(22.0));
        assert_eq!((codec.psnr(99), codec.psnr(100), codec.psnr(401)), (None, Some(20.0), None));
        assert_eq!(codec.within(399).map(|file| file.bytes), Some(100));
        assert!(codec.ms_ssim(200).is_none() && codec.within(99).is_none());
    }
}
