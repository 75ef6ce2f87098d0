//! The scans that a run began with, recognized by their content.

use crate::LidarRunError;
use crate::plan::name;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use weaver_io::{Checksum, LIDAR_FORMATS, list_files, natural_order, read_bytes};

/// Names of scans in the order in which they are taken, with checksums of their files; none of a file that could not be read.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(transparent)]
pub(crate) struct Sources(Vec<(String, Option<String>)>);

impl Sources {
    /// The scans in a folder as they are now, in natural order.
    pub fn of(folder: &Path) -> Result<Self, LidarRunError> {
        let checksum = |file: &PathBuf| {
            let mut sum = Checksum::default();
            sum.bytes(&read_bytes(file).ok()?);
            Some(sum.to_string())
        };
        let mut scans = list_files(folder, &LIDAR_FORMATS)?;
        scans.sort_by(|a, b| natural_order(a.as_os_str(), b.as_os_str()));
        for scan in &scans {
            weaver_io::path_in_utf8(scan)?;
        }
        Ok(Self(scans.iter().map(|file| (name(file), checksum(file))).collect()))
    }

    /// The files in a folder.
    pub fn files(&self, folder: &Path) -> Vec<PathBuf> {
        self.0.iter().map(|(name, _)| folder.join(name)).collect()
    }

    /// Checks that a folder has the scans that a run began with, and no others. A file that could not be read then may be another now.
    ///
    /// # Errors
    /// Names the first that differs.
    pub fn check(&self, folder: &Path) -> Result<(), LidarRunError> {
        let now = Self::of(folder)?;
        for i in 0..self.0.len().max(now.0.len()) {
            let (name, found) = match (self.0.get(i), now.0.get(i)) {
                (Some((name, began)), Some((other, sum))) if name == other => match began.is_none() || began == sum {
                    true => continue,
                    false => (name, "another"),
                },
                (Some((name, _)), _) if !now.0.iter().any(|(other, _)| other == name) => (name, "none"),
                (_, Some((other, _))) | (Some((other, _)), None) => (other, "one more"),
                (None, None) => continue,
            };
            return Err(LidarRunError::Invalid {
                path: folder.join(name),
                what: "scan",
                expected: "that with which the run began".into(),
                found: found.into(),
            });
        }
        Ok(())
    }
}
