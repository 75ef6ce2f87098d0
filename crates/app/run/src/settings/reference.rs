//! Settings with their documentation.

use super::ranges::Range;
use super::schema::{is_optional, properties, schema, variant};
use super::{Error, Settings, to_toml};
use serde_json::Value as Schema;
use std::fmt::Write;
use toml::Table;

/// Widest line of a comment.
const WIDTH: usize = 110;

/// Settings as TOML text in which every key is preceded by its documentation; optional keys without a value stand,
/// commented out, at the end of their table.
///
/// # Errors
/// When TOML has no form for a value, such as a list of optional values with one missing.
pub fn annotate<S: Settings>(settings: &S) -> Result<String, Error> {
    Ok(annotated(&to_toml(settings)?, schema::<S>()))
}

fn annotated(toml: &str, root: &Schema) -> String {
    let mut out = String::new();
    let mut table = root;
    let mut seen: Vec<String> = Vec::new();
    let mut lines = toml.lines();
    while let Some(line) = lines.next() {
        let header = line.strip_prefix("[[").and_then(|l| l.strip_suffix("]]"));
        let header = header.or_else(|| line.strip_prefix('[').and_then(|l| l.strip_suffix(']')));
        if let Some(path) = header {
            unset(&mut out, table, &seen);
            seen.clear();
            table = path.split('.').fold(root, |schema, key| inner(schema, key));
            if !out.is_empty() {
                out.push('\n');
            }
            comment(&mut out, table);
            let _ = writeln!(out, "{line}");
        } else if let Some((key, value)) = line.split_once(" = ") {
            comment(&mut out, inner(table, key));
            seen.push(key.into());
            let mut entry = line.to_string();
            // A text with line breaks goes on until it is TOML.
            while entry.parse::<Table>().is_err() {
                let Some(more) = lines.next() else { break };
                entry = format!("{entry}\n{more}");
            }
            let _ = writeln!(out, "{entry}");
            if key == "kind" {
                table = variant(table, value.trim_matches('"'));
            }
        }
    }
    unset(&mut out, table, &seen);
    out
}

/// The schema of a key; of the entries, where it is a list of tables.
fn inner<'s>(schema: &'s Schema, key: &str) -> &'s Schema {
    let found = properties(schema).into_iter().find(|(name, _)| *name == key).map_or(&Schema::Null, |(_, s)| s);
    if found["items"]["properties"].is_object() { &found["items"] } else { found }
}

/// Optional keys of a table that have no value.
fn unset(out: &mut String, table: &Schema, seen: &[String]) {
    for (key, schema) in properties(table) {
        if is_optional(schema) && !seen.iter().any(|s| s == key) {
            comment(out, schema);
            let _ = writeln!(out, "# {key} =");
        }
    }
}

fn comment(out: &mut String, schema: &Schema) {
    let text = schema["description"].as_str().unwrap_or("").replace('\n', " ");
    let choices: Vec<String> = schema["oneOf"].as_array().into_iter().flatten().filter_map(choice).collect();
    let text = if choices.is_empty() { text } else { format!("{text} One of: {}.", choices.join("; ")) };
    let text = match Range::stated(schema) {
        Some(range) => format!("{text} Range: {range}."),
        None => text,
    };
    let mut line = String::from("#");
    for word in text.split_whitespace() {
        if line.len() + word.len() >= WIDTH {
            let _ = writeln!(out, "{line}");
            line = String::from("#");
        }
        let _ = write!(line, " {word}");
    }
    if line.len() > 1 {
        let _ = writeln!(out, "{line}");
    }
}

/// A value of a closed choice and its meaning.
fn choice(schema: &Schema) -> Option<String> {
    let value = schema["const"].as_str().or_else(|| schema["properties"]["kind"]["const"].as_str())?;
    let meaning = schema["description"].as_str().unwrap_or("").trim_end_matches('.');
    Some(format!("{value}: {}", meaning.replace('\n', " ")))
}
