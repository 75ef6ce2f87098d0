//! What JSON files are asked for.

use crate::files::file::{read_bytes, without_mark};
use crate::{Error, Result};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Reads a file, which may begin with a byte order mark.
///
/// # Errors
/// When it cannot be read or is not JSON.
pub(crate) fn read(path: &Path) -> Result<Value> {
    serde_json::from_slice(without_mark(&read_bytes(path)?))
        .map_err(|e| Error::invalid(path, format!("line {} column {}", e.line(), e.column()), "JSON", not_json(&e)))
}

/// Name in errors of text that is not JSON.
pub(crate) fn not_json(error: &serde_json::Error) -> String {
    format!("what is not ({error})")
}

/// Name of a value's kind in errors.
pub(crate) fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "a boolean",
        Value::Number(_) => "a number",
        Value::String(_) => "a string",
        Value::Array(_) => "a list",
        Value::Object(_) => "an object",
    }
}

/// A file and what it holds, by key; a key that is missing is `null`.
pub(crate) struct JsonFile {
    path: PathBuf,
    value: Value,
}

impl JsonFile {
    /// Reads a file whose top level is an object.
    ///
    /// # Errors
    /// When it cannot be read, is not JSON or holds no object.
    pub fn open(path: PathBuf) -> Result<Self> {
        let value = read(&path)?;
        if !value.is_object() {
            return Err(Error::invalid(&path, "top level", "an object", kind(&value)));
        }
        Ok(Self { path, value })
    }

    pub fn has(&self, key: &str) -> bool {
        !self.value[key].is_null()
    }

    pub fn get(&self, key: &str) -> &Value {
        &self.value[key]
    }

    /// A number.
    pub fn number(&self, key: &str) -> Result<f64> {
        let value = &self.value[key];
        value.as_f64().ok_or_else(|| self.invalid(key, "a number", found(value)))
    }

    /// A list of `N` numbers.
    pub fn numbers<const N: usize>(&self, key: &str) -> Result<[f64; N]> {
        numbers(&self.value[key]).ok_or_else(|| {
            let value = &self.value[key];
            self.invalid(key, &format!("{N} numbers"), found(value))
        })
    }

    /// A list of strings.
    pub fn strings(&self, key: &str) -> Result<Vec<String>> {
        let list =
            self.value[key].as_array().and_then(|list| list.iter().map(|x| x.as_str().map(String::from)).collect());
        list.ok_or_else(|| self.invalid(key, "a list of strings", found(&self.value[key])))
    }

    pub fn invalid(&self, key: &str, expected: &str, found: String) -> Error {
        Error::invalid(&self.path, key, expected, found)
    }
}

/// A value as `N` numbers.
pub(crate) fn numbers<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let list: Option<Vec<f64>> = value.as_array()?.iter().map(Value::as_f64).collect();
    list?.try_into().ok()
}

/// A value as errors show it: a short one as it is.
pub(crate) fn found(value: &Value) -> String {
    match value {
        Value::Null => "nothing".into(),
        Value::Object(_) => kind(value).into(),
        Value::Array(list) if list.len() > 8 => format!("a list of {}", list.len()),
        _ => value.to_string().chars().take(100).collect(),
    }
}
