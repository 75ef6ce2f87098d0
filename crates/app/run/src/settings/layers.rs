//! Laying one TOML tree over another: every key must exist, and a wrong one gets the nearest name.

use super::ranges;
use super::schema::{is_number, is_optional, join, properties, property, schema, variant};
use super::{Error, Settings, nearest};
use serde_json::Value as Schema;
use std::collections::BTreeSet;
use std::marker::PhantomData;
use std::path::Path;
use toml::{Table, Value};

/// Resolves defaults < file < settings (`key=value`, the key a dotted path).
///
/// # Errors
/// When the file cannot be read, or a key or value is wrong.
pub fn resolve<S: Settings>(defaults: &S, file: Option<&Path>, sets: &[String]) -> Result<S, Error> {
    Layers::of(defaults, file, sets)?.finish(&source(file, sets))
}

/// Name of a file and settings together in errors.
pub fn source(file: Option<&Path>, sets: &[String]) -> String {
    let file = file.map(|file| file.display().to_string());
    file.into_iter().chain(sets.iter().cloned()).collect::<Vec<_>>().join(", ")
}

/// Settings while layers are laid over their defaults.
#[derive(Clone, Debug)]
pub struct Layers<S> {
    tree: Value,
    schema: &'static Schema,
    /// Keys that a layer has given, as dotted paths.
    given: BTreeSet<String>,
    settings: PhantomData<fn() -> S>,
}

impl<S: Settings> Layers<S> {
    /// The lowest layer.
    ///
    /// # Errors
    /// When TOML cannot hold a value, such as a whole number beyond the range of signed 64 bits.
    pub fn new(defaults: &S) -> Result<Self, Error> {
        let tree = Value::try_from(defaults).map_err(|e| Error::invalid("defaults", e.to_string()))?;
        Ok(Self { tree, schema: schema::<S>(), given: BTreeSet::new(), settings: PhantomData })
    }

    /// Lays a file and settings over defaults.
    ///
    /// # Errors
    /// When the file cannot be read, or a key is unknown or a value has another type.
    pub fn of(defaults: &S, file: Option<&Path>, sets: &[String]) -> Result<Self, Error> {
        let mut layers = Self::new(defaults)?;
        if let Some(path) = file {
            layers.merge(read_table(path)?, &path.display().to_string())?;
        }
        sets.iter().try_for_each(|setting| layers.set(setting))?;
        Ok(layers)
    }

    /// Lays a table over the settings so far: tables key by key, lists of tables entry by entry, everything else as a
    /// whole. An entry of a list starts from the entry in its place, or from the last one. `source` names the table in
    /// errors.
    ///
    /// # Errors
    /// When a key is unknown or a value has another type.
    pub fn merge(&mut self, over: Table, source: &str) -> Result<(), Error> {
        let over = Value::Table(over);
        add_keys(&over, "", &mut self.given);
        merge_at(&mut self.tree, over, self.schema, source, "")
    }

    /// Applies one `key=value`: the key is a dotted path (list entries by number), the value TOML or a bare word; the
    /// word `none` unsets an optional key.
    ///
    /// # Errors
    /// When the key is unknown or the value has another type.
    pub fn set(&mut self, setting: &str) -> Result<(), Error> {
        let (key, value) = key_and_value(setting)?;
        add_keys(&value, key, &mut self.given);
        set(&mut self.tree, self.schema, setting)
    }

    /// True if a layer above the lowest has given this key, a dotted path.
    pub fn gives(&self, key: &str) -> bool {
        self.given.contains(key)
    }

    /// The settings; `source` names the last layer in errors.
    ///
    /// # Errors
    /// When a value is not one that its key can have, or a number is out of its range.
    pub fn finish(self, source: &str) -> Result<S, Error> {
        let Self { tree, schema, .. } = self;
        deserialize(tree, schema, source)
    }
}

/// Reads a table from a TOML file.
///
/// # Errors
/// When the file cannot be read, or is not TOML.
pub fn read_table(path: impl AsRef<Path>) -> Result<Table, Error> {
    let path = path.as_ref();
    parse_table(&weaver_io::read_text(path)?, &path.display().to_string())
}

/// Parses settings that are complete, without defaults; `source` names the text in errors.
///
/// # Errors
/// When the text is not TOML, a key or value is wrong, or a number is out of its range.
pub fn parse<S: Settings>(text: &str, source: &str) -> Result<S, Error> {
    deserialize(Value::Table(parse_table(text, source)?), schema::<S>(), source)
}

/// Checks the range of every number of settings that were made in code; `source` names them in errors.
///
/// # Errors
/// When a number is out of its range, not finite, or beyond the range of TOML.
pub fn check<S: Settings>(settings: &S, source: &str) -> Result<(), Error> {
    let tree = Value::try_from(settings).map_err(|e| Error::invalid(source, e.to_string()))?;
    ranges::check(&tree, schema::<S>(), "").map_err(|message| Error::invalid(source, message))
}

/// Settings as TOML text.
///
/// # Errors
/// When TOML has no form for a value, such as a list of optional values with one missing.
pub fn to_toml<S: Settings>(settings: &S) -> Result<String, Error> {
    toml::to_string(settings).map_err(|e| Error::invalid("settings", e.to_string()))
}

fn parse_table(text: &str, source: &str) -> Result<Table, Error> {
    text.parse().map_err(|e: toml::de::Error| Error::invalid(source, e.to_string()))
}

fn deserialize<S: Settings>(tree: Value, schema: &Schema, source: &str) -> Result<S, Error> {
    let ranges = ranges::check(&tree, schema, "");
    // The error names the key on a line of its own; a message is one line.
    let wrong = |e: toml::de::Error| Error::invalid(source, e.to_string().trim().replace('\n', " "));
    let settings = tree.try_into().map_err(wrong)?;
    ranges.map_err(|message| Error::invalid(source, message))?;
    Ok(settings)
}

fn unknown(schema: &Schema, key: &str, source: &str, path: &str) -> Error {
    let known = properties(schema);
    let hint =
        nearest(key, known.iter().map(|(name, _)| *name)).map_or(String::new(), |n| format!("; did you mean `{n}`?"));
    Error::invalid(source, format!("unknown key `{}`{hint}", join(path, key)))
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
                    None => _ = base.insert(key, numeric(inner, value)),
                }
            }
            Ok(())
        }
        (Value::Array(base), Value::Array(over)) if base.first().is_some_and(Value::is_table) => {
            // Each entry starts from the entry that was in its place, or from the last one.
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
                return Err(Error::invalid(
                    source,
                    format!("{path}: expected {expected}, found {} `{over}`", over.type_str()),
                ));
            }
            *base = over;
            Ok(())
        }
    }
}

/// Adds the dotted paths of a value's leaves.
fn add_keys(value: &Value, path: &str, keys: &mut BTreeSet<String>) {
    match value {
        Value::Table(table) => table.iter().for_each(|(key, value)| add_keys(value, &join(path, key), keys)),
        _ => _ = keys.insert(path.into()),
    }
}

/// The parts of `key=value`, whose value is TOML or a bare word.
fn key_and_value(setting: &str) -> Result<(&str, Value), Error> {
    let (key, text) = setting.split_once('=').ok_or_else(|| Error::invalid(setting, "expected key=value"))?;
    let text = text.trim();
    let value = format!("value = {text}").parse::<Table>().ok().and_then(|mut table| table.remove("value"));
    Ok((key.trim(), value.unwrap_or_else(|| Value::String(text.into()))))
}

fn set(tree: &mut Value, schema: &Schema, setting: &str) -> Result<(), Error> {
    let (key, value) = key_and_value(setting)?;
    let text = setting.split_once('=').map_or("", |(_, text)| text.trim());
    let (mut slot, mut schema, mut path) = (tree, schema, String::new());
    let parts: Vec<&str> = key.split('.').collect();
    for (i, part) in parts.iter().enumerate() {
        let last = i + 1 == parts.len();
        slot = match slot {
            Value::Table(table) => {
                let outer = schema;
                let inner = property(outer, part).ok_or_else(|| unknown(outer, part, setting, &path))?;
                schema = inner;
                if last && is_optional(inner) && text == "none" {
                    table.remove(*part);
                    return Ok(());
                }
                if last && *part == "kind" && table.get("kind") != Some(&value) {
                    // Keys that the other variant has as well stay.
                    table.retain(|key, _| property(variant(outer, text), key).is_some());
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
                part.parse::<usize>().ok().and_then(|i| list.get_mut(i)).ok_or_else(|| {
                    Error::invalid(setting, format!("{path}: expected an index below {count}, found `{part}`"))
                })?
            }
            _ => return Err(Error::invalid(setting, format!("{path} has no part `{part}`"))),
        };
        path = join(&path, part);
    }
    merge_at(slot, value, schema, setting, &path)
}

/// A whole number where the schema says that fractions are fine, as a fraction.
fn numeric(schema: &Schema, value: Value) -> Value {
    match value {
        Value::Integer(i) if is_number(schema) => Value::Float(i as f64),
        value => value,
    }
}
