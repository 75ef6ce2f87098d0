//! JSON files of results.

use serde_json::Value;
use std::fmt::Write;
use std::path::Path;
use weaver_command::Failure;
use weaver_io::read_text;
use weaver_trainer::Summary;

/// Entries of lists and tables that are shown, and characters of one.
const SHOWN: usize = 20;
const LINE: usize = 200;

/// The outcome of a training run, or the entries of whatever else the file has.
pub fn of_json(path: &Path) -> Result<String, Failure> {
    let wrong = |e: serde_json::Error| Failure::message(format!("{}: {e}", path.display()));
    let value: Value = serde_json::from_str(&read_text(path)?).map_err(wrong)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    if let Ok(Summary { steps, planned, parameters, seconds, checksum, evaluation, seed, .. }) =
        serde_json::from_value(value.clone())
    {
        let mut text = format!("{name}: {steps} of {planned} steps, seed {seed}, {parameters} parameters\n");
        let _ = writeln!(text, "last session: {seconds:.0} s; checksum of the weights: {checksum}");
        let _ = writeln!(text, "{}", evaluation.map_or("not evaluated yet".into(), |evaluation| evaluation.table()));
        return Ok(text);
    }
    Ok(format!("{name}\n{}", entries(&value)))
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
