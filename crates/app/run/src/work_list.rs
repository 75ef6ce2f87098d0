//! Lists of work: one command for many inputs.

use serde::Deserialize;
use std::path::{Path, PathBuf};
use weaver_io::list_folders;

/// A list of work, as a TOML file with tables `[[work]]` has it.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct WorkList {
    /// Its parts.
    pub work: Vec<Work>,
}

/// One command for many inputs.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Work {
    /// Name of the command.
    pub command: String,
    /// Files and folders; a last part `*` stands for every folder there.
    pub inputs: Vec<PathBuf>,
    /// Folder for the folders of results.
    pub out: PathBuf,
    /// Further words of the command.
    #[serde(default)]
    pub flags: Vec<String>,
}

/// An input of a command.
#[derive(Clone, Debug, PartialEq)]
pub struct WorkInput {
    /// The file or folder.
    pub path: PathBuf,
    /// True if a `*` stands for it.
    pub found: bool,
}

impl Work {
    /// The inputs, in order, with the folders that a `*` stands for.
    ///
    /// # Errors
    /// When a folder cannot be read.
    pub fn expanded(&self) -> Result<Vec<WorkInput>, weaver_io::Error> {
        let mut all = Vec::new();
        for input in &self.inputs {
            let Some(parent) = input.to_str().and_then(|text| text.strip_suffix('*')).map(Path::new) else {
                all.push(WorkInput { path: input.clone(), found: false });
                continue;
            };
            let folders = list_folders(parent)?;
            all.extend(folders.into_iter().map(|path| WorkInput { path, found: true }));
        }
        Ok(all)
    }
}
