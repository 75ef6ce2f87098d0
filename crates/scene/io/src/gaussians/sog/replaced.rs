//! A scene of several files in a folder, and in folders in it: all of them are written or none, and over no file of
//! others.

use super::encode::File;
use super::{LOD_META, META, names};
use crate::files::output_folder::refused;
use crate::files::unfinished::UnfinishedFile;
use crate::{Error, Result};
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Writes the files of a scene beside its `meta.json` or `lod-meta.json`, which comes last among them.
///
/// # Errors
/// When a file of such a name is there that no scene at this place names, and when one cannot be written.
pub(in crate::gaussians) fn write(meta: &Path, files: &[File]) -> Result<()> {
    let beside = |name: &str| meta.with_file_name(name);
    let own = named_before(meta)?;
    for path in files.iter().map(|file| beside(&file.name)).filter(|path| path.symlink_metadata().is_ok()) {
        if !own.contains(&path) {
            return Err(refused(&path, "no file, or one of the scene that is replaced", "another one"));
        }
    }
    // All are complete before any has its name: a disk that is full leaves the scene as it was.
    let mut complete = Vec::new();
    for File { name, content } in files {
        let path = beside(name);
        let written = || -> std::io::Result<_> {
            path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
            let mut file = UnfinishedFile::begin(&path)?;
            file.as_file().write_all(content)?;
            file.flush()?;
            Ok(file)
        };
        complete.push((written().map_err(Error::io(&path))?, path));
    }
    // Without it there is no scene, so that no reader finds a partly replaced one.
    remove(meta)?;
    for (file, path) in complete {
        file.persist().map_err(Error::io(&path))?;
    }
    let written: BTreeSet<PathBuf> = files.iter().map(|file| beside(&file.name)).collect();
    for path in own.iter().filter(|path| !written.contains(*path)) {
        remove(path)?;
        // A folder of a level goes with its last file.
        path.parent().filter(|folder| Some(*folder) != meta.parent()).map(std::fs::remove_dir);
    }
    Ok(())
}

/// The files of the scene that is there already.
///
/// # Errors
/// When there is a `meta.json` of something else.
fn named_before(meta: &Path) -> Result<Vec<PathBuf>> {
    if meta.symlink_metadata().is_err() {
        return Ok(Vec::new());
    }
    let names = names(meta).map_err(|_| refused(meta, "no file, or that of a scene", "another one"))?;
    // A file of others may name anything.
    let known = |name: &String| {
        let (folder, last) = name.rsplit_once('/').unwrap_or(("", name));
        let of_level = folder.split('_').all(|number| !number.is_empty() && number.bytes().all(|c| c.is_ascii_digit()));
        (folder.is_empty() || of_level) && ([META, LOD_META].contains(&last) || NAMES.contains(&last))
    };
    Ok(names.into_iter().filter(known).map(|name| meta.with_file_name(name)).collect())
}

/// Names of pictures that scenes are written with.
const NAMES: [&str; 7] =
    ["means_l.webp", "means_u.webp", "quats.webp", "scales.webp", "sh0.webp", "shN_centroids.webp", "shN_labels.webp"];

fn remove(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(Error::io(path)(error)),
        _ => Ok(()),
    }
}
