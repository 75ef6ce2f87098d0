//! A configuration with its documentation.

use super::overlay::{is_optional, properties};
use serde_json::Value as Schema;
use std::fmt::Write;

/// Widest line of a comment.
const WIDTH: usize = 110;

/// Puts each key's documentation above it, and optional keys without a value, commented out, at the end of their table.
pub(super) fn annotate(toml: &str, root: &Schema) -> String {
    let mut out = String::new();
    let mut table = root;
    let mut seen: Vec<String> = Vec::new();
    for line in toml.lines() {
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
            let _ = writeln!(out, "{line}");
            if key == "kind" {
                table = variant(table, value.trim_matches('"'));
            }
        }
    }
    unset(&mut out, table, &seen);
    out
}

/// The variant of this kind, where a table has several.
fn variant<'s>(table: &'s Schema, kind: &str) -> &'s Schema {
    let mut variants = table["oneOf"].as_array().into_iter().flatten();
    variants.find(|schema| schema["properties"]["kind"]["const"] == kind).unwrap_or(table)
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

/// A value of a closed choice and what it means.
fn choice(schema: &Schema) -> Option<String> {
    let value = schema["const"].as_str().or_else(|| schema["properties"]["kind"]["const"].as_str())?;
    let meaning = schema["description"].as_str().unwrap_or("").trim_end_matches('.');
    Some(format!("{value}: {}", meaning.replace('\n', " ")))
}
