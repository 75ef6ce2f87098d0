//! Folders.

use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// The files in `folder` with one of the `extensions` (without the dot, in either case), sorted by path.
pub fn list_files(folder: impl AsRef<Path>, extensions: &[&str]) -> Result<Vec<PathBuf>> {
    let folder = folder.as_ref();
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let path = entry.map_err(Error::io(folder))?.path();
        let wanted = |extension: &std::ffi::OsStr| extensions.iter().any(|e| extension.eq_ignore_ascii_case(e));
        if path.extension().is_some_and(wanted) && path.is_file() {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// Creates a folder and its parents.
///
/// # Errors
/// When it cannot be created.
pub fn create_folder(path: impl AsRef<Path>) -> Result<()> {
    let path = path.as_ref();
    std::fs::create_dir_all(path).map_err(Error::io(path))
}
