//! Laying one TOML tree over another: every key must be known, and a wrong one gets the nearest name.

use crate::{Config, Error, Recipe};
use serde::de::DeserializeOwned;
use serde_json::Value as Schema;
use std::path::Path;
use toml::{Table, Value};

/// What every key of a configuration is, by the documentation and types of its sections.
pub(super) fn schema<R: Recipe>() -> Schema {
    let settings = schemars::generate::SchemaSettings::default().with(|s| s.inline_subschemas = true);
    settings.into_generator().into_root_schema_for::<Config<R>>().to_value()
}

pub(super) fn parse(text: &str, source: &str) -> Result<Table, Error> {
    text.parse().map_err(|e: toml::de::Error| error(source, e.to_string()))
}

pub(super) fn read_file(path: &Path) -> Result<Table, Error> {
    parse(&weaver_io::read_text(path)?, &path.display().to_string())
}

fn error(place: &str, message: impl Into<String>) -> Error {
    Error::Config { place: place.into(), message: message.into() }
}

/// The candidate most like `name`, if any is like it at all.
pub(super) fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    candidates
        .into_iter()
        .map(|c| (strsim::jaro_winkler(name, c), c))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(likeness, _)| *likeness > 0.7)
        .map(|(_, c)| c)
}

fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.into() } else { format!("{path}.{key}") }
}

/// The keys of a table with their schemas, those of all its variants if it has several.
pub(super) fn properties(schema: &Schema) -> Vec<(&str, &Schema)> {
    let own = schema["properties"].as_object().into_iter().flatten().map(|(key, value)| (key.as_str(), value));
    let variants = ["oneOf", "anyOf"].into_iter().filter_map(|k| schema[k].as_array()).flatten();
    own.chain(variants.flat_map(properties)).collect()
}

fn property<'s>(schema: &'s Schema, key: &str) -> Option<&'s Schema> {
    properties(schema).into_iter().find(|(name, _)| *name == key).map(|(_, schema)| schema)
}

fn unknown(schema: &Schema, key: &str, source: &str, path: &str) -> Error {
    let known = properties(schema);
    let hint =
        nearest(key, known.iter().map(|(name, _)| *name)).map_or(String::new(), |n| format!("; did you mean `{n}`?"));
    error(source, format!("unknown key `{}`{hint}", join(path, key)))
}

/// Lays `over` on `base`: tables key by key, lists of tables entry by entry, everything else as a whole.
pub(super) fn merge(base: &mut Value, over: Value, schema: &Schema, source: &str) -> Result<(), Error> {
    merge_at(base, over, schema, source, "")
}

fn merge_at(base: &mut Value, over: Value, schema: &Schema, source: &str, path: &str) -> Result<(), Error> {
    match (base, over) {
        (Value::Table(base), Value::Table(over)) => {
            if let Some(kind) = over.get("kind")
                && base.get("kind").is_some_and(|old| old != kind)
            {
                // Another variant has other keys.
                base.clear();
            }
            for (key, value) in over {
                let inner = property(schema, &key).ok_or_else(|| unknown(schema, &key, source, path))?;
                match base.get_mut(&key) {
                    Some(slot) => merge_at(slot, value, inner, source, &join(path, &key))?,
                    None => _ = base.insert(key, value),
                }
            }
            Ok(())
        }
        (Value::Array(base), Value::Array(over)) if base.first().is_some_and(Value::is_table) => {
            // A list of stages in a file: each entry starts from the preset's entry of its place, or from the last one.
            let template = base.clone();
            base.clear();
            for (i, entry) in over.into_iter().enumerate() {
                let mut slot = template[i.min(template.len() - 1)].clone();
                merge_at(&mut slot, entry, &schema["items"], source, &join(path, &i.to_string()))?;
                base.push(slot);
            }
            Ok(())
        }
        (base, over) => {
            // 1 is a fine way to write 1.0.
            let over = match (&*base, over) {
                (Value::Float(_), Value::Integer(i)) => Value::Float(i as f64),
                (_, over) => over,
            };
            if base.type_str() != over.type_str() {
                let expected = base.type_str();
                return Err(error(source, format!("{path}: expected {expected}, found {} `{over}`", over.type_str())));
            }
            *base = over;
            Ok(())
        }
    }
}

/// Applies one `key=value`: the key is a dotted path (list entries by number), the value TOML or a bare word; the word
/// `none` unsets an optional key.
pub(super) fn set(tree: &mut Value, schema: &Schema, setting: &str) -> Result<(), Error> {
    let (key, text) = setting.split_once('=').ok_or_else(|| error(setting, "expected key=value"))?;
    let (key, text) = (key.trim(), text.trim());
    let value = format!("value = {text}")
        .parse::<Table>()
        .ok()
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| Value::String(text.into()));
    let (mut slot, mut schema, mut path) = (tree, schema, String::new());
    let parts: Vec<&str> = key.split('.').collect();
    for (i, part) in parts.iter().enumerate() {
        let last = i + 1 == parts.len();
        slot = match slot {
            Value::Table(table) => {
                let inner = property(schema, part).ok_or_else(|| unknown(schema, part, setting, &path))?;
                schema = inner;
                let optional = is_optional(inner);
                if last && optional && text == "none" {
                    table.remove(*part);
                    return Ok(());
                }
                if !table.contains_key(*part) {
                    let fresh = if last { numeric(inner, value.clone()) } else { Value::Table(Table::new()) };
                    table.insert((*part).into(), fresh);
                }
                table.get_mut(*part).expect("just found or put there")
            }
            Value::Array(list) => {
                schema = &schema["items"];
                let count = list.len();
                part.parse::<usize>()
                    .ok()
                    .and_then(|i| list.get_mut(i))
                    .ok_or_else(|| error(setting, format!("{path}: expected an index below {count}, found `{part}`")))?
            }
            _ => return Err(error(setting, format!("{path} has no part `{part}`"))),
        };
        path = join(&path, part);
    }
    merge_at(slot, value, schema, setting, &path)
}

/// Whether a key may be left out.
pub(super) fn is_optional(schema: &Schema) -> bool {
    let null = |s: &Schema| s["type"] == "null";
    schema["type"].as_array().is_some_and(|types| types.iter().any(|t| t == "null"))
        || schema["anyOf"].as_array().is_some_and(|any| any.iter().any(null))
}

/// A whole number where the schema says that fractions are fine, as a fraction.
fn numeric(schema: &Schema, value: Value) -> Value {
    let number =
        schema["type"] == "number" || schema["type"].as_array().is_some_and(|t| t.iter().any(|t| t == "number"));
    match value {
        Value::Integer(i) if number => Value::Float(i as f64),
        value => value,
    }
}

pub(super) fn deserialize<D: DeserializeOwned>(tree: Value, source: &str) -> Result<D, Error> {
    // The error names the key on a line of its own; a message is one line.
    tree.try_into().map_err(|e: toml::de::Error| error(source, e.to_string().trim().replace('\n', " ")))
}
