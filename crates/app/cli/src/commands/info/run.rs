//! The folder of a run of any command: what was asked for, how far it came, what it wrote.

use super::json::{entries, of_json};
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;
use weaver_command::Failure;
use weaver_io::{read_text, written};
use weaver_run::{Folder, read_records};

/// The file of settings of runs whose settings are no TOML.
pub const SETTINGS: &str = "run.json";
/// Files that are listed.
const SHOWN: usize = 20;
/// Files that every run has, which are described or say nothing.
const COMMON: [&str; 5] = [SETTINGS, Folder::CHECKPOINT, Folder::LOG, Folder::SUMMARY, "unit.json"];

/// Describes the folder of a run.
pub fn of_run_folder(path: &Path) -> Result<String, Failure> {
    let record = written(path)?;
    let mut text = match record.get(SETTINGS) {
        Some(command) => format!("run of `{command}`\n"),
        None => "run\n".into(),
    };
    let file = path.join(SETTINGS);
    let wrong = |e: serde_json::Error| Failure::message(format!("{}: {e}", file.display()));
    let settings: Value = serde_json::from_str(&read_text(&file)?).map_err(wrong)?;
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
    let summary = path.join(Folder::SUMMARY);
    if summary.is_file() {
        text += &of_json(&summary)?;
    }
    Ok(text)
}
