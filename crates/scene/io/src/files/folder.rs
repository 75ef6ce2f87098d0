//! Folders.

use crate::files::unfinished::UnfinishedFile;
use crate::{Error, Result};
use std::path::{Component, Path, PathBuf};

/// The files in `folder` with one of the `extensions` (without the dot, in either case), sorted by path.
pub fn list_files(folder: impl AsRef<Path>, extensions: &[&str]) -> Result<Vec<PathBuf>> {
    let mut files = list_named(folder.as_ref(), extensions)?;
    files.retain(|path| path.is_file());
    Ok(files)
}

/// Every entry of `folder` with one of the `extensions`, sorted by path: files, folders, and links that lead nowhere.
pub(crate) fn list_named(folder: &Path, extensions: &[&str]) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let path = entry.map_err(Error::io(folder))?.path();
        let wanted = |extension: &std::ffi::OsStr| extensions.iter().any(|e| extension.eq_ignore_ascii_case(e));
        if path.extension().is_some_and(wanted) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
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
    // Its path is one that it never takes.
    UnfinishedFile::begin(&existing.join(".weaver"))
        .map(drop)
        .map_err(|source| Error::io(existing)(std::io::Error::from(source.kind())))
}

/// The path to a file from a folder, with forward slashes on every system: the name of a photo in files of cameras, so
/// that both can be moved together. Neither needs to exist.
///
/// Symbolic links above the file are followed, because `..` leads out of the folder where they end. The file's own name
/// is kept. Where no relative path exists, as between two drives, the absolute one is returned.
///
/// # Errors
/// When the path is not UTF-8, which is all that such files can hold.
pub fn relative_path(from_folder: impl AsRef<Path>, to_file: impl AsRef<Path>) -> Result<String> {
    let to = to_file.as_ref();
    let absolute = std::path::absolute(to).map_err(Error::io(to))?;
    let file = match (absolute.parent(), absolute.file_name()) {
        (Some(folder), Some(name)) => followed(folder).join(name),
        _ => absolute.clone(),
    };
    // The parent of a file's name alone is a path without parts, which is the working directory.
    let from = Path::new(".").join(from_folder);
    let from = followed(&std::path::absolute(&from).map_err(Error::io(&from))?);
    let shared = from.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    if shared == 0 {
        return Ok(in_utf8(to, &absolute)?.replace(std::path::MAIN_SEPARATOR, "/"));
    }
    let up = std::iter::repeat_n("..", from.components().count() - shared).map(Path::new);
    let down = file.components().skip(shared).map(|part| Path::new(part.as_os_str()));
    let parts: Vec<&str> = up.chain(down).map(|part| in_utf8(to, part)).collect::<Result<_>>()?;
    Ok(parts.join("/"))
}

/// True if a name is taken: by a file, a folder, or a link, also one that leads nowhere.
pub fn is_taken(path: impl AsRef<Path>) -> bool {
    path.as_ref().symlink_metadata().is_ok()
}

/// A path that exists, without links; on Windows as people write it, without the prefix `\\?\`.
pub(crate) fn canonical(path: &Path) -> std::io::Result<PathBuf> {
    dunce::canonicalize(path)
}

/// A path without links and without `..`, as far as it exists, and its remaining parts.
pub(crate) fn followed(path: &Path) -> PathBuf {
    let found = path.ancestors().find_map(|above| Some((canonical(above).ok()?, path.strip_prefix(above).ok()?)));
    let Some((mut followed, rest)) = found else { return path.to_path_buf() };
    for part in rest.components() {
        if part == Component::ParentDir {
            followed.pop();
        } else {
            followed.push(part);
        }
    }
    followed
}

/// A path as text, for files that name it.
///
/// # Errors
/// When it is not UTF-8.
pub fn path_in_utf8(path: &Path) -> Result<&str> {
    in_utf8(path, path)
}

/// A part of a path as text.
fn in_utf8<'a>(path: &Path, part: &'a Path) -> Result<&'a str> {
    part.to_str().ok_or_else(|| Error::invalid(path, "path", "UTF-8, for files that name it", "other bytes"))
}

/// Creates a folder and its parents.
///
/// # Errors
/// When it cannot be created.
pub fn create_folder(path: impl AsRef<Path>) -> Result<()> {
    let path = path.as_ref();
    std::fs::create_dir_all(path).map_err(Error::io(path))
}
