//! Masks of photos.

use super::photo::Photo;
use crate::Error;
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use weaver_io::{Image, PhotoFile};

/// A photo's mask.
#[derive(Clone, Debug)]
pub(crate) struct Mask {
    /// Its file; `None` if only the photo's alpha can be one.
    pub file: Option<PathBuf>,
    /// True if black counts in the file.
    pub inverted: bool,
    place: Place,
}

/// A folder of masks.
#[derive(Clone, Debug)]
pub(crate) struct Place {
    /// The folder that paths of photos are relative to.
    base: PathBuf,
    masks: PathBuf,
}

impl Place {
    /// The folder `masks` of a capture.
    fn of_capture(folder: &Path) -> Self {
        Self { base: folder.to_path_buf(), masks: folder.join("masks") }
    }

    /// Masks by the ends of the photos' paths.
    fn by_name(masks: &Path) -> Self {
        Self { base: PathBuf::new(), masks: masks.to_path_buf() }
    }
}

/// The masks of a capture's photos: `mask_path` of the frame, relative to the capture's folder; else [`beside`] the
/// photo.
///
/// # Errors
/// When a `mask_path` is not there, or as [`beside`].
pub(super) fn of_capture(photos: &[Photo], folder: &Path) -> Result<Vec<Mask>, Error> {
    let named = |photo: &Photo| photo.frame.mask.as_ref().map(|mask| folder.join(mask));
    let place = || Place::of_capture(folder);
    beside(photos.iter().map(|photo| (photo.frame.path.as_path(), place(), named(photo))))
}

/// The masks of photos that belong to no capture: in a folder `masks` beside the photo, or beside the photo's folder.
///
/// # Errors
/// As [`beside`].
pub(super) fn of_photos(photos: &[PathBuf]) -> Result<Vec<Mask>, Error> {
    beside(photos.iter().map(|photo| (photo.as_path(), place_of(photo), None)))
}

/// The masks of photos in a folder, named as the photos are.
///
/// # Errors
/// As [`beside`].
pub(super) fn in_folder(photos: &[PathBuf], masks: &Path) -> Result<Vec<Mask>, Error> {
    beside(photos.iter().map(|photo| (photo.as_path(), Place::by_name(masks), None)))
}

/// The masks of photos whose cameras stand in a file of many: as the file says, else as [`of_photos`].
///
/// # Errors
/// As [`of_capture`].
pub(super) fn of_known(photos: &[Photo], cameras: &Path) -> Result<Vec<Mask>, Error> {
    let named = |photo: &Photo| photo.frame.mask.as_ref().map(|mask| super::folder(cameras).join(mask));
    beside(photos.iter().map(|photo| (photo.frame.path.as_path(), place_of(&photo.frame.path), named(photo))))
}

fn place_of(photo: &Path) -> Place {
    let above = photo.ancestors().skip(1).take(2);
    let with_masks = above.clone().find(|folder| folder.join("masks").is_dir());
    Place::of_capture(with_masks.or(photo.parent()).unwrap_or(Path::new("")))
}

/// The mask of each photo, given the photos, where their masks are, and the files that are named.
///
/// Without a name it is a file in `masks/` with the photo's path, or with the end of it: `masks/images/a/1.png`,
/// `masks/a/1.png` and `masks/1.png` may mask `images/a/1.png`. It has the photo's extension, `.png` in its place, or
/// `.png` behind it.
///
/// # Errors
/// When a file that is named is not there, or a file in `masks/` would belong to several photos.
fn beside<'a>(photos: impl Iterator<Item = (&'a Path, Place, Option<PathBuf>)>) -> Result<Vec<Mask>, Error> {
    let mut owners: BTreeMap<PathBuf, &Path> = BTreeMap::new();
    let mut masks = Vec::new();
    for (photo, place, named) in photos {
        if let Some(file) = named {
            if !file.is_file() {
                return Err(Error::unexpected(photo, "mask_path", file.display().to_string(), "no such file"));
            }
            masks.push(Mask { file: Some(file), inverted: false, place });
            continue;
        }
        let file = candidates(photo, &place).into_iter().find(|file| file.is_file());
        if let Some(file) = &file
            && let Some(other) = owners.insert(file.clone(), photo)
        {
            let both = format!("{} and {}", other.display(), photo.display());
            return Err(Error::unexpected(file, "mask", "one photo of this name, or masks in folders", both));
        }
        masks.push(Mask { file, inverted: false, place });
    }
    Ok(masks)
}

impl Mask {
    /// A mask in a file, whose white counts.
    pub fn at(file: PathBuf) -> Self {
        let place = Place::of_capture(file.parent().unwrap_or(Path::new("")));
        Self { file: Some(file), inverted: false, place }
    }

    /// The same mask where black counts in its file, or white.
    pub fn with_inverted(&self, inverted: bool) -> Self {
        Self { inverted, ..self.clone() }
    }

    /// The mask of a photo, bright where the photo counts.
    ///
    /// # Errors
    /// When there is none, it cannot be read, or it has not the photo's size.
    pub fn open(&self, path: &Path, photo: PhotoFile) -> Result<PhotoFile, Error> {
        let (width, height) = photo.size();
        let Some(file) = &self.file else {
            let expected = || expected(path, &self.place);
            return photo
                .alpha()
                .ok_or_else(|| Error::unexpected(path, "mask", expected(), "no such file, and no alpha"));
        };
        let mask = PhotoFile::at(file)?.for_camera(width, height).over([0.0; 3]);
        if mask.size() != (width, height) {
            let (w, h) = mask.size();
            let expected = format!("{width}x{height}, its photo's");
            return Err(Error::unexpected(file, "image size", expected, format!("{w}x{h}")));
        }
        Ok(if self.inverted { mask.inverted() } else { mask })
    }

    /// The folder of masks that it was looked for in.
    pub fn folder(&self) -> &Path {
        &self.place.masks
    }
}

/// Least part of a pixel inside the mask for the pixel to have a color of its own.
const LEAST_INSIDE: f32 = 0.5;

/// Cuts a photo that was read over white by its mask that was read in the same way, and returns which pixels count;
/// `None` if all do.
///
/// Masked pixels become white. Pixels on the border, which are part white, get the color of their inner part.
pub(super) fn cut(photo: &mut Image, mask: &Image) -> Option<Vec<bool>> {
    let mut inside = Vec::with_capacity(photo.width * photo.height);
    for (color, part) in photo.pixels.chunks_exact_mut(3).zip(mask.pixels.chunks_exact(3)) {
        let part = part[0];
        inside.push(part >= LEAST_INSIDE);
        color.iter_mut().for_each(|c| {
            *c = if part >= LEAST_INSIDE { ((*c - (1.0 - part)) / part).clamp(0.0, 1.0) } else { 1.0 };
        });
    }
    inside.contains(&false).then_some(inside)
}

/// Places of a photo's mask, for messages.
fn expected(photo: &Path, place: &Place) -> String {
    let mut all = candidates(photo, place);
    let mut last = all.split_off(all.len().saturating_sub(3));
    // The photo's extension may be the mask's.
    last.dedup();
    last.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(" or ") + ", or a photo with alpha"
}

/// Possible places of a photo's mask, the longest names first.
fn candidates(photo: &Path, Place { base, masks }: &Place) -> Vec<PathBuf> {
    let inside = photo.strip_prefix(base).unwrap_or(photo);
    let normal = |part: &Component<'_>| matches!(part, Component::Normal(_));
    let parts: Vec<Component<'_>> = inside.components().filter(normal).collect();
    let of_end = |start: usize| {
        let end: PathBuf = parts[start..].iter().collect();
        let mut behind = end.clone().into_os_string();
        behind.push(".png");
        [masks.join(&end), masks.join(end.with_extension("png")), masks.join(behind)]
    };
    (0..parts.len()).flat_map(of_end).collect()
}
