//! The record of a folder of results: its lines, and the whole read without a claim on the folder.

use crate::{Result, read_text};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Component, Path};

/// The record's name in its folder.
pub(super) const RECORD: &str = "written.jsonl";

/// The files that this program wrote into a folder, by its record: names relative to the folder, and the command that
/// wrote each. None where there is no record. Names that lead out of the folder are left out, and so is a line that a
/// kill cut short.
///
/// # Errors
/// When the record cannot be read.
pub fn written(folder: impl AsRef<Path>) -> Result<BTreeMap<String, String>> {
    let path = folder.as_ref().join(RECORD);
    if !path.exists() {
        return Ok(BTreeMap::new());
    }
    Ok(read_text(path)?.lines().filter_map(entry).collect())
}

/// File and command of a line. None for a damaged line, and for a name that leads out of the folder: a record may come
/// along with a folder of somebody else.
pub(super) fn entry(line: &str) -> Option<(String, String)> {
    let value: Value = serde_json::from_str(line).ok()?;
    let inside = |name: &&str| Path::new(name).components().all(|part| matches!(part, Component::Normal(_)));
    Some((value["file"].as_str().filter(inside)?.to_string(), value["by"].as_str()?.to_string()))
}
