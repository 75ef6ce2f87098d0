//! The content of `meta.json`.

use super::META;
use crate::files::json::{found, not_json};
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::Path;

/// The version that is read and written.
pub(super) const VERSION: u64 = 2;
/// Name of `model` where Gaussians were trained antialiased.
pub(super) const ANTIALIASED: &str = "antialiased";

#[derive(Debug, Deserialize, Serialize)]
pub(super) struct Meta {
    pub version: u64,
    pub count: usize,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    pub means: Means,
    pub scales: Coded,
    pub quats: Quats,
    pub sh0: Coded,
    #[serde(default, rename = "shN", skip_serializing_if = "Option::is_none")]
    pub rest: Option<Palette>,
}

/// Bounds of positions on a logarithmic scale; the lower and the upper byte of each coordinate.
#[derive(Debug, Deserialize, Serialize)]
pub(super) struct Means {
    pub mins: [f32; 3],
    pub maxs: [f32; 3],
    pub files: [String; 2],
}

#[derive(Debug, Deserialize, Serialize)]
pub(super) struct Quats {
    pub files: [String; 1],
}

/// Entries of a table.
#[derive(Debug, Deserialize, Serialize)]
pub(super) struct Coded {
    pub codebook: Vec<f32>,
    pub files: [String; 1],
}

/// Harmonics beyond degree 0: `count` rows of entries of a table, and the row of each Gaussian.
#[derive(Debug, Deserialize, Serialize)]
pub(super) struct Palette {
    pub count: usize,
    pub bands: usize,
    pub codebook: Vec<f32>,
    pub files: [String; 2],
}

impl Meta {
    /// Names of the pictures.
    pub(super) fn files(self) -> impl Iterator<Item = String> {
        let rest = self.rest.into_iter().flat_map(|rest| rest.files);
        self.means.files.into_iter().chain(self.scales.files).chain(self.quats.files).chain(self.sh0.files).chain(rest)
    }

    pub(super) fn read(path: &Path, data: &[u8]) -> Result<Self> {
        let place = |e: &serde_json::Error| format!("{META} line {} column {}", e.line(), e.column());
        let value: Value =
            serde_json::from_slice(data).map_err(|e| Error::invalid(path, place(&e), "JSON", not_json(&e, data)))?;
        if value["version"] != VERSION {
            let found = found(&value["version"]);
            return Err(Error::invalid(path, format!("{META}, version"), VERSION, found));
        }
        serde_json::from_value(value).map_err(|e| Error::invalid(path, META, "the keys of SOG 2", e))
    }
}
