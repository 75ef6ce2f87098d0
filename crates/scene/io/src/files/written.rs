//! The record of a folder of results, read without a claim on the folder.

use crate::{Result, read_text};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Component, Path};

/// The files that this program wrote into a folder, by its record: names relative to the folder, and the command that
/// wrote each. None where there is no record. Names that lead out of the folder are left out, and so is a line that a
/// kill cut short.
///
/// # Errors
/// When the record cannot be read.
pub fn written(folder: impl AsRef<Path>) -> Result<BTreeMap<String, String>> {
    let path = folder.as_ref().join("written.jsonl");
    if !path.exists() {
        return Ok(BTreeMap::new());
    }
    let entry = |line: &str| -> Option<(String, String)> {
        let value: Value = serde_json::from_str(line).ok()?;
        Some((value["file"].as_str()?.to_string(), value["by"].as_str()?.to_string()))
    };
    let inside = |name: &str| Path::new(name).components().all(|part| matches!(part, Component::Normal(_)));
    Ok(read_text(path)?.lines().filter_map(entry).filter(|(name, _)| inside(name)).collect())
}
