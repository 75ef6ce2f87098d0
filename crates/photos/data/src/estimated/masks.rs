//! Masks of photos whose cameras are estimated.

use super::loading::Loaded;
use crate::Error;
use crate::capture::Mask;
use crate::remarks::some_of;
use std::path::{Path, PathBuf};

/// The file of a photo's mask.
#[derive(Clone, Debug)]
pub(super) struct PhotoMask {
    pub file: PathBuf,
    /// True if black counts.
    pub inverted: bool,
}

impl PhotoMask {
    /// The file of a mask; `None` where the photo's alpha is the mask.
    pub fn of(mask: &Mask) -> Option<Self> {
        let file = mask.file.as_ref()?;
        Some(Self { file: std::path::absolute(file).unwrap_or_else(|_| file.clone()), inverted: mask.inverted })
    }
}

/// Names the photos that masks cover.
///
/// # Errors
/// When these are all photos.
pub(super) fn covered(names: &[String], loaded: &[Loaded]) -> Result<Option<String>, Error> {
    let covered = names.iter().zip(loaded).filter(|(_, loaded)| loaded.is_masked());
    let covered: Vec<String> = covered.map(|(name, _)| name.clone()).collect();
    if covered.is_empty() {
        return Ok(None);
    }
    if covered.len() == loaded.len() {
        let expected = "white where a photo counts; where black counts, masks are to be inverted (--invert-masks)";
        let found = "black all over, in the masks of all photos";
        return Err(Error::unexpected(Path::new(&covered[0]), "mask", expected, found));
    }
    Ok(Some(format!("masks cover all of {}; nothing of it is used", some_of(&covered))))
}
