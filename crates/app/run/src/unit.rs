//! Units of work that may be started again: the files of their results.

use crate::{Error, Folder};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use weaver_io::{OutputFolder, read_text, write_text, written};

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

/// The mark of a folder.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Mark {
    /// Checksum of inputs and settings.
    pub unit: String,
    /// True if the results are complete.
    pub complete: bool,
    /// The files of complete results; none in marks of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub files: Option<Vec<String>>,
}

impl Mark {
    /// The mark of a folder; `None` without one.
    ///
    /// # Errors
    /// When its file cannot be read, or has something else.
    pub fn read(out: &Path) -> Result<Option<Self>, Error> {
        let mark = out.join(MARK);
        if !mark.is_file() {
            return Ok(None);
        }
        serde_json::from_str(&read_text(&mark)?).map(Some).map_err(|_| Error::Unit { mark })
    }

    /// Marks a folder, of results that are made of `inputs`.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, out: &Path, inputs: &[PathBuf]) -> Result<(), Error> {
        // The claim ends with this write, so that the command can claim the folder in turn.
        let folder = OutputFolder::claim(out, "unit", inputs)?;
        let mark = serde_json::to_string(self).expect("text is JSON") + "\n";
        Ok(write_text(folder.file(MARK)?, &mark)?)
    }

    /// The files of complete results that are not there any more; `figures` is one of them, where it is given.
    ///
    /// # Errors
    /// When the record cannot be read.
    pub fn gone(self, out: &Path, figures: Option<&str>) -> Result<Vec<String>, Error> {
        let mut files = self.files.map_or_else(|| recorded(out), Ok)?;
        files.extend(figures.map(String::from));
        files.retain(|name| !out.join(name).exists());
        Ok(files)
    }
}
