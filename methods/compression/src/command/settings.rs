//! Settings of a comparison.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Settings of a comparison, as stored in its folder.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    pub scenes: Vec<PathBuf>,
    pub methods: Vec<String>,
    pub peer: Vec<PathBuf>,
    pub cameras: Option<PathBuf>,
    pub data: Option<PathBuf>,
    pub steps: usize,
    pub seed: u64,
    pub chamfer: bool,
    /// Checksums of the scenes with their views, from the beginning of the run.
    pub read: Vec<String>,
}
