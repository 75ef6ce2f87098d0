//! Masks of photos whose cameras are not known yet.

use super::masks::{self, Mask};
use crate::Error;
use crate::remarks::some_of;
use std::path::{Path, PathBuf};
use weaver_io::{OutputFolder, list_photos};

/// The folder of masks that are written.
pub(crate) const MASKS: &str = "masks";

/// Where masks of photos are, and whether black counts in them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MaskOptions {
    /// A folder of masks with the photos' names, or the ends of their paths; `None` takes a folder `masks` beside a
    /// photo, or beside its folder, and the alpha of photos without a mask there.
    pub folder: Option<PathBuf>,
    /// True if black counts in the files.
    pub inverted: bool,
}

/// Masks of photos, one for each: white where a photo counts.
///
/// ```
/// use weaver_data::capture::{MaskOptions, PhotoMasks};
///
/// let folder = tempfile::tempdir().unwrap();
/// let masks = MaskOptions { folder: Some(folder.path().join("masks")), inverted: false };
/// let error = PhotoMasks::find(&["a.jpg".into()], &masks).unwrap_err();
/// assert!(error.to_string().contains("no such folder"));
/// ```
#[derive(Clone, Debug)]
pub struct PhotoMasks {
    pub(crate) masks: Vec<Mask>,
    /// Names the masks of no photo.
    pub(crate) remark: Option<String>,
}

impl PhotoMasks {
    /// Finds the masks of photos: files with a photo's name or the end of its path, with its own extension, `.png` in
    /// its place, or `.png` behind it.
    ///
    /// Photos without a file are no error yet: their alpha may be their mask.
    ///
    /// # Errors
    /// When the folder is not there, or a mask would belong to several photos.
    pub fn find(photos: &[PathBuf], options: &MaskOptions) -> Result<Self, Error> {
        let mut masks = match &options.folder {
            Some(folder) if !folder.is_dir() => {
                let expected = "a folder of masks, each with the name of its photo";
                return Err(Error::unexpected(folder, "masks", expected, "no such folder"));
            }
            Some(folder) => masks::in_folder(photos, folder)?,
            None => masks::of_photos(photos)?,
        };
        for (mask, photo) in masks.iter_mut().zip(photos) {
            if mask.file.as_ref().is_some_and(|file| file.canonicalize().is_ok_and(|file| is_at(photo, &file))) {
                return Err(Error::unexpected(photo, "mask", "a file beside it", "the photo itself"));
            }
            *mask = mask.with_inverted(options.inverted);
        }
        let remark = remark(&masks)?;
        Ok(Self { masks, remark })
    }

    /// Checks that a folder has a place for the masks that estimated cameras come with: to be called before photos are
    /// matched.
    ///
    /// # Errors
    /// Names the first file that is not to be replaced.
    pub fn check(&self, out: &OutputFolder) -> Result<(), Error> {
        // Others stay where they are.
        let written = self.masks.iter().any(|mask| mask.inverted && mask.file.is_some());
        if written { Ok(out.check_folder(MASKS)?) } else { Ok(()) }
    }
}

fn is_at(photo: &Path, place: &Path) -> bool {
    photo.canonicalize().is_ok_and(|photo| photo == place)
}

/// Names the masks that no photo has.
fn remark(masks: &[Mask]) -> Result<Option<String>, Error> {
    let mut folders: Vec<&Path> = masks.iter().map(Mask::folder).filter(|folder| folder.is_dir()).collect();
    folders.sort();
    folders.dedup();
    let mut unused = Vec::new();
    for folder in folders {
        let used = |file: &PathBuf| masks.iter().any(|mask| mask.file.as_ref() == Some(file));
        unused
            .extend(list_photos(folder)?.into_iter().filter(|file| !used(file)).map(|file| file.display().to_string()));
    }
    let are = if unused.len() == 1 { "masks: no photo has the name of" } else { "masks: no photos have the names of" };
    Ok((!unused.is_empty()).then(|| format!("{are} {}", some_of(&unused))))
}
