//! Folders that are searched for photos.

use crate::{Result, list_folders, list_photos};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Levels of folders that are looked into, and folders in all: a home folder has many.
const DEEPEST: usize = 3;
const MOST: usize = 500;
/// The folder of masks, which are no photos.
const MASKS: &str = "masks";

/// Photos of a folder, and where else there may be some.
#[derive(Clone, Debug, Default)]
pub struct PhotoFolder {
    /// The photos in it, as [`list_photos`] lists them.
    pub photos: Vec<PathBuf>,
    /// Folders below it that have photos, sorted by path, with their counts: cameras' folders, such as `DCIM/100APPLE`.
    /// Hidden folders, `masks` and links are left out.
    pub below: Vec<(PathBuf, usize)>,
    /// Extensions of its files that are no photos, in lower case, and how many have each, most first.
    pub others: Vec<(String, usize)>,
}

impl PhotoFolder {
    /// Looks into a folder, and into those below it as far as three levels.
    ///
    /// # Errors
    /// When it cannot be read.
    ///
    /// ```
    /// let folder = tempfile::tempdir().unwrap();
    /// std::fs::create_dir_all(folder.path().join("100APPLE")).unwrap();
    /// std::fs::write(folder.path().join("100APPLE/IMG_1.jpg"), "").unwrap();
    /// let found = weaver_io::PhotoFolder::open(folder.path())?;
    /// assert_eq!((found.photos.len(), found.below.len()), (0, 1));
    /// # Ok::<(), weaver_io::Error>(())
    /// ```
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let photos = list_photos(path)?;
        let mut below = Vec::new();
        let mut left = MOST;
        for folder in folders(path) {
            search(&folder, DEEPEST, &mut left, &mut below);
        }
        Ok(Self { others: if photos.is_empty() { others(path) } else { Vec::new() }, photos, below })
    }
}

/// Adds a folder and those below it, if they have photos. An unreadable folder has none to offer.
fn search(folder: &Path, levels: usize, left: &mut usize, found: &mut Vec<(PathBuf, usize)>) {
    let Some(fewer) = left.checked_sub(1).filter(|_| levels > 0) else { return };
    *left = fewer;
    match list_photos(folder) {
        Ok(photos) if !photos.is_empty() => found.push((folder.to_path_buf(), photos.len())),
        _ => {}
    }
    for folder in folders(folder) {
        search(&folder, levels - 1, left, found);
    }
}

/// The folders in a folder that may have photos.
fn folders(path: &Path) -> Vec<PathBuf> {
    let mut folders = list_folders(path).unwrap_or_default();
    folders.retain(|folder| {
        let name = folder.file_name().unwrap_or_default();
        name != MASKS && !name.as_encoded_bytes().starts_with(b".") && !folder.is_symlink()
    });
    folders
}

/// Extensions of the files in a folder, with their numbers.
fn others(path: &Path) -> Vec<(String, usize)> {
    let mut numbers: BTreeMap<String, usize> = BTreeMap::new();
    let files = std::fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path());
    for file in files.filter(|file| file.is_file()) {
        if let Some(extension) = file.extension() {
            *numbers.entry(extension.to_string_lossy().to_lowercase()).or_default() += 1;
        }
    }
    let mut numbers: Vec<(String, usize)> = numbers.into_iter().collect();
    numbers.sort_by_key(|(_, number)| std::cmp::Reverse(*number));
    numbers
}
