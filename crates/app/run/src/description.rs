//! The description of a run of any command from its folder: settings, progress, files.

use crate::settings::{self, read_table};
use crate::{Error, Folder, read_records};
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;
use weaver_io::{read_text, written};

/// The file of settings of runs whose settings are no TOML.
pub const SETTINGS: &str = "run.json";
/// Files, and entries of lists, that are shown.
const SHOWN: usize = 20;
/// Characters of an entry.
const LINE: usize = 200;
/// Files that every run has; they are described in other words, or not at all.
const COMMON: [&str; 5] = [SETTINGS, Folder::CHECKPOINT, Folder::LOG, Folder::SUMMARY, "unit.json"];

/// Describes the folder of a run, but for its summary.
///
/// # Errors
/// When a file of it cannot be read.
pub fn describe(path: &Path) -> Result<String, Error> {
    let record = written(path)?;
    let mut text = match record.get(SETTINGS) {
        Some(command) => format!("run of `{command}`\n"),
        None => "run\n".into(),
    };
    let file = path.join(SETTINGS);
    let settings: Value = serde_json::from_str(&read_text(&file)?)
        .map_err(|error| weaver_io::Error::Io { path: file, source: std::io::Error::other(error) })?;
    text += &entries(&settings);
    let log = path.join(Folder::LOG);
    let step = if log.is_file() { read_records(&log)?.last().map(|record| record.step) } else { None };
    let checkpoint = if path.join(Folder::CHECKPOINT).is_file() { "a checkpoint" } else { "no checkpoint" };
    let _ = match step {
        Some(step) => writeln!(text, "{step} steps logged, {checkpoint}"),
        None => writeln!(text, "no step logged yet, {checkpoint}"),
    };
    let is_result = |name: &&String| !COMMON.contains(&name.as_str()) && path.join(name).exists();
    let files: Vec<&String> = record.keys().filter(is_result).collect();
    if !files.is_empty() {
        let shown = files.iter().take(SHOWN).map(|name| name.as_str()).collect::<Vec<_>>().join(", ");
        let more = files.len().saturating_sub(SHOWN);
        let _ = writeln!(text, "files: {shown}{}", if more > 0 { format!(" and {more} more") } else { String::new() });
    }
    Ok(text)
}

/// True if a JSON file is of results, and no file of cameras, of a scene or of an index of weights.
///
/// # Errors
/// When the file cannot be read.
pub fn is_of_results(path: &Path) -> Result<bool, Error> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    if ["meta.json", "lod-meta.json"].contains(&&*name) || name.ends_with(".index.json") {
        return Ok(false);
    }
    // Text that is no JSON is refused by the readers of cameras, which name the place.
    let value: Option<Value> = serde_json::from_str(&read_text(path)?).ok();
    Ok(name == "summary.json" || value.is_some_and(|value| value.get("frames").is_none()))
}

/// Describes a file of settings, TOML: a line for each entry, and of tables and lists of tables their number.
///
/// # Errors
/// When the file cannot be read.
pub fn describe_table(path: &Path) -> Result<String, settings::Error> {
    let table = read_table(path)?;
    let mut text = format!("TOML, {} keys\n", table.len());
    for (key, value) in &table {
        let value = match value {
            settings::Value::Table(inner) => format!("{} keys", inner.len()),
            settings::Value::Array(list) if list.iter().any(|entry| entry.is_table()) => {
                format!("{} tables", list.len())
            }
            value => value.to_string(),
        };
        let _ = writeln!(text, "{key}: {value}");
    }
    Ok(text)
}

/// A line for each entry of a table, or of a list; tables and lists in these are counted.
pub fn entries(value: &Value) -> String {
    let short = |value: &Value| match value {
        Value::Object(inner) => format!("{} keys", inner.len()),
        Value::Array(inner) if inner.len() > 4 || inner.iter().any(|x| x.is_object() || x.is_array()) => {
            format!("{} entries", inner.len())
        }
        value => cut(&value.to_string()),
    };
    match value {
        Value::Object(table) => {
            let shown = table.iter().filter(|(_, value)| !value.is_null());
            shown.map(|(key, value)| format!("{key}: {}\n", short(value))).collect()
        }
        Value::Array(list) => {
            let lines: String = list.iter().take(SHOWN).map(|entry| format!("{}\n", cut(&entry.to_string()))).collect();
            let more = list.len().saturating_sub(SHOWN);
            lines + &if more > 0 { format!("and {more} more\n") } else { String::new() }
        }
        value => format!("{value}\n"),
    }
}

/// The beginning of a long text.
fn cut(text: &str) -> String {
    let short: String = text.chars().take(LINE).collect();
    if short.len() < text.len() { short + "..." } else { short }
}
