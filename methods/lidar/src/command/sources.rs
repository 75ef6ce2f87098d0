//! The scans of a run, identified by their content.

use crate::command::LidarRunError;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weaver_io::{Checksum, LIDAR_FORMATS, list_files, natural_order, read_bytes};

/// Checksums of scans by the names of their files; `None` for an unreadable file.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(transparent)]
pub(crate) struct Sources(BTreeMap<String, Option<String>>);

impl Sources {
    /// The scans in a folder at present.
    pub fn of(folder: &Path) -> Result<Self, LidarRunError> {
        let mut all = BTreeMap::new();
        for file in list_files(folder, &LIDAR_FORMATS)? {
            weaver_io::path_in_utf8(&file)?;
            let checksum = read_bytes(&file).ok().map(|bytes| {
                let mut sum = Checksum::default();
                sum.bytes(&bytes);
                sum.to_string()
            });
            all.insert(file.file_name().unwrap_or_default().to_string_lossy().into_owned(), checksum);
        }
        Ok(Self(all))
    }

    /// The files in a folder, in natural order.
    pub fn files(&self, folder: &Path) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> = self.0.keys().map(|name| folder.join(name)).collect();
        files.sort_by(|a, b| natural_order(a.as_os_str(), b.as_os_str()));
        files
    }

    /// Checks that a folder has the scans of the run's beginning, and no others. A formerly unreadable file may have
    /// changed.
    ///
    /// # Errors
    /// Names the first scan that differs.
    pub fn check(&self, folder: &Path) -> Result<(), LidarRunError> {
        let now = Self::of(folder)?;
        let differs = |name: &&String| match (self.0.get(*name), now.0.get(*name)) {
            (Some(Some(began)), Some(found)) => found.as_ref() != Some(began),
            (began, found) => began.is_none() || found.is_none(),
        };
        let Some(name) = self.0.keys().chain(now.0.keys()).find(differs) else { return Ok(()) };
        let found = match (self.0.contains_key(name), now.0.contains_key(name)) {
            (true, true) => "another",
            (true, false) => "none",
            _ => "one more",
        };
        Err(LidarRunError::Invalid {
            path: folder.join(name),
            what: "scan",
            expected: "that with which the run began".into(),
            found: found.into(),
        })
    }
}
