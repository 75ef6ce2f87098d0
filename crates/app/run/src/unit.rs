//! Units of work that may be started again: the files of their results.

use crate::Folder;
use std::path::Path;
use weaver_io::written;

/// The file with the identity of a folder's results, and with their completeness.
pub const MARK: &str = "unit.json";
/// Folders inside a unit's folder with a record of their own: the estimated cameras.
const PARTS: [&str; 1] = ["cameras"];

/// The existing results in a folder, by its record.
///
/// # Errors
/// When the record cannot be read.
pub fn results(out: &Path) -> Result<Vec<String>, weaver_io::Error> {
    let mut files = recorded(out)?;
    files.retain(|name| out.join(name).exists());
    Ok(files)
}

/// The results of a folder, by its record, missing ones too. A checkpoint is none: it may be removed to save space.
///
/// # Errors
/// When the record cannot be read.
pub fn recorded(out: &Path) -> Result<Vec<String>, weaver_io::Error> {
    let mut files: Vec<String> = written(out)?.into_keys().collect();
    for part in PARTS {
        files.extend(written(out.join(part))?.into_keys().map(|name| format!("{part}/{name}")));
    }
    files.retain(|name| ![MARK, Folder::CHECKPOINT].contains(&name.as_str()));
    Ok(files)
}
