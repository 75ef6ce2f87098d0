//! Reads and resizes photos for the published networks.

use crate::Error;
use rayon::prelude::*;
use std::path::PathBuf;
use weaver_io::{Image, PhotoFile};

/// Framing of photos to the network's size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Framing {
    /// As the official evaluation does: resized until they cover the size, and cut to it about the middle.
    Crop,
    /// Resized whole: the long side becomes the longer of the size, the other follows, rounded to whole patches.
    /// Nothing is lost; the proportions may change by a fraction of a patch.
    KeepAspect,
}

/// The size (H, W) that photos are brought to: the first decides it where proportions are kept.
///
/// # Errors
/// When there is no photo, or the first is missing or no image.
pub fn size_of(paths: &[PathBuf], size: [usize; 2], patch: usize, framing: Framing) -> Result<[usize; 2], Error> {
    let Some(first) = paths.first() else { return Err(Error::Input("expected at least one photo".into())) };
    Ok(match framing {
        Framing::Crop => size,
        Framing::KeepAspect => whole_patches(Image::dimensions(first)?, size, patch),
    })
}

/// Reads photos and brings all to `size` (H, W). With [`Framing::KeepAspect`], photos of other proportions than the
/// first are cut.
///
/// # Errors
/// When a file is missing or no image.
pub fn read(paths: &[PathBuf], size: [usize; 2], patch: usize, framing: Framing) -> Result<Vec<Image>, Error> {
    let read = |path: &PathBuf| -> Result<Image, Error> {
        let photo = PhotoFile::at(path)?;
        let whole = framing == Framing::KeepAspect && whole_patches(photo.size(), size, patch) == size;
        if whole { Ok(photo.resize_bicubic(size[1], size[0])?.to_image()) } else { cover(&photo, size) }
    };
    let images: Vec<Result<Image, Error>> = paths.par_iter().map(read).collect();
    images.into_iter().collect()
}

/// The size (H, W) in whole patches of a photo whose long side becomes the longer of `size`.
fn whole_patches((width, height): (usize, usize), size: [usize; 2], patch: usize) -> [usize; 2] {
    let long = size[0].max(size[1]);
    let rounded = |side: usize, of: usize| {
        let exact = long as f64 * side as f64 / of as f64;
        ((exact / patch as f64).round() as usize).max(1) * patch
    };
    if width >= height { [rounded(height, width), long] } else { [long, rounded(width, height)] }
}

/// Resizes the photo until it covers the size, and cuts it about the middle: bicubic, rounding down, as Pillow and the
/// official script do.
fn cover(photo: &PhotoFile, [height, width]: [usize; 2]) -> Result<Image, Error> {
    let (w, h) = photo.size();
    let by_height = w * height >= h * width;
    let (new_width, new_height) = if by_height { (w * height / h, height) } else { (width, h * width / w) };
    let resized = photo.resize_bicubic(new_width.max(width), new_height.max(height))?.to_image();
    Ok(resized.crop((resized.width - width) / 2, (resized.height - height) / 2, width, height))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The long side leads and the short one keeps whole patches.
    #[test]
    fn the_long_side_leads() {
        assert_eq!(whole_patches((1600, 900), [448, 448], 14), [252, 448]);
        assert_eq!(whole_patches((900, 1600), [448, 448], 14), [448, 252]);
        assert_eq!(whole_patches((10_000, 10), [448, 448], 14), [14, 448]);
        assert_eq!(whole_patches((640, 480), [448, 448], 14), [336, 448]);
    }

    #[test]
    fn what_covers_is_cut_about_the_middle() {
        // Left half red, right half blue, twice as wide as high.
        let mut image = Image::filled(40, 20, [1.0, 0.0, 0.0]);
        image
            .pixels
            .chunks_mut(3)
            .enumerate()
            .filter(|(i, _)| i % 40 >= 20)
            .for_each(|(_, p)| p.copy_from_slice(&[0.0, 0.0, 1.0]));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        image.write_png(&path).unwrap();
        let photo = PhotoFile::at(&path).unwrap();
        let cut = cover(&photo, [10, 10]).unwrap();
        assert_eq!((cut.width, cut.height), (10, 10));
        assert_eq!((&cut.pixels[..3], &cut.pixels[27..30]), (&[1.0, 0.0, 0.0][..], &[0.0, 0.0, 1.0][..]));
        let same = cover(&photo, [20, 40]).unwrap();
        assert_eq!(same.pixels, image.pixels);
    }
}
