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

/// The folders in `folder`, sorted by path.
///
/// # Errors
/// When it cannot be read.
pub fn list_folders(folder: impl AsRef<Path>) -> Result<Vec<PathBuf>> {
    let folder = folder.as_ref();
    let mut folders = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let path = entry.map_err(Error::io(folder))?.path();
        if path.is_dir() {
            folders.push(path);
        }
    }
    folders.sort();
    Ok(folders)
}

/// Checks that files can be written into a folder, which need not exist yet. Leaves nothing behind.
///
/// Meant to be called before long work whose result is written there.
///
/// # Errors
/// When it, or the nearest existing path above it, is not a folder or cannot be written to.
pub fn check_writable(folder: impl AsRef<Path>) -> Result<()> {
    let folder = folder.as_ref();
    let mut above = folder.ancestors().map(|path| if path.as_os_str().is_empty() { Path::new(".") } else { path });
    let existing = above.find(|path| path.exists()).unwrap_or(Path::new("."));
    if !existing.is_dir() {
        return Err(Error::invalid(
            folder,
            "folder",
            "one that can be written to",
            format!("a file, {}", existing.display()),
        ));
    }
    let probe = tempfile::Builder::new().prefix(".weaver-").tempfile_in(existing);
    probe.map(drop).map_err(|source| Error::io(existing)(std::io::Error::from(source.kind())))
}

/// Creates a folder and its parents.
///
/// # Errors
/// When it cannot be created.
pub fn create_folder(path: impl AsRef<Path>) -> Result<()> {
    let path = path.as_ref();
    std::fs::create_dir_all(path).map_err(Error::io(path))
}
