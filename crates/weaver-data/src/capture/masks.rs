//! Which part of a photo counts.

use super::photo::Photo;
use crate::Error;
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

/// Where each photo's mask is; `None` where there is no file, so that only the photo's alpha may say.
///
/// `mask_path` of the frame, relative to the capture's folder; else a file in `masks/` with the photo's path, or with the end of it:
/// `masks/images/a/1.png`, `masks/a/1.png` and `masks/1.png` may be that of `images/a/1.png`. It has the photo's extension, `.png` in its
/// place, or `.png` behind it.
///
/// # Errors
/// When a `mask_path` is not there, or a file in `masks/` would be that of several photos.
pub(super) fn files(photos: &[Photo], folder: &Path) -> Result<Vec<Option<PathBuf>>, Error> {
    let mut owners: BTreeMap<PathBuf, &Path> = BTreeMap::new();
    let mut files = Vec::new();
    for Photo { frame, .. } in photos {
        if let Some(mask) = &frame.mask {
            let file = folder.join(mask);
            if !file.is_file() {
                return Err(Error::unexpected(&frame.path, "mask_path", file.display().to_string(), "no such file"));
            }
            files.push(Some(file));
            continue;
        }
        let found = candidates(&frame.path, folder).into_iter().find(|file| file.is_file());
        if let Some(file) = &found
            && let Some(other) = owners.insert(file.clone(), &frame.path)
        {
            let both = format!("{} and {}", other.display(), frame.path.display());
            return Err(Error::unexpected(file, "mask", "one photo of this name, or masks in folders", both));
        }
        files.push(found);
    }
    Ok(files)
}

/// Where a photo's mask was looked for, for messages.
pub(super) fn expected(photo: &Path, folder: &Path) -> String {
    let mut all = candidates(photo, folder);
    let mut last = all.split_off(all.len().saturating_sub(3));
    // The photo's extension may be the mask's.
    last.dedup();
    last.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(" or ") + ", or a photo with alpha"
}

/// Where a photo's mask may be, the longest names first.
fn candidates(photo: &Path, folder: &Path) -> Vec<PathBuf> {
    let inside = photo.strip_prefix(folder).unwrap_or(photo);
    let normal = |part: &Component<'_>| matches!(part, Component::Normal(_));
    let parts: Vec<Component<'_>> = inside.components().filter(normal).collect();
    let masks = folder.join("masks");
    let of_end = |start: usize| {
        let end: PathBuf = parts[start..].iter().collect();
        let mut behind = end.clone().into_os_string();
        behind.push(".png");
        [masks.join(&end), masks.join(end.with_extension("png")), masks.join(behind)]
    };
    (0..parts.len()).flat_map(of_end).collect()
}
