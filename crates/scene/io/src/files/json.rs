//! Reading values from JSON files.

use crate::files::file::{read_bytes, without_mark};
use crate::{Error, Result};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Reads a file, which may begin with a byte order mark.
///
/// # Errors
/// When it cannot be read or is not JSON.
pub(crate) fn read(path: &Path) -> Result<Value> {
    let bytes = read_bytes(path)?;
    let text = without_mark(&bytes);
    serde_json::from_slice(text).map_err(|e| {
        Error::invalid(path, format!("line {} column {}", e.line(), e.column()), "JSON", not_json(&e, text))
    })
}

/// Name in errors of text that is not JSON; of a number that JSON has no word for, with its key.
pub(crate) fn not_json(error: &serde_json::Error, text: &[u8]) -> String {
    let Some((word, key)) = not_a_number(error, text) else { return format!("what is not ({error})") };
    let of = key.map_or(String::new(), |key| format!(" in {key:?}"));
    format!("{word}{of}, a number that JSON has no word for; Python's json.dumps writes it unless allow_nan=False")
}

/// The word for NaN or infinity that an error points at, and the key before it.
fn not_a_number(error: &serde_json::Error, text: &[u8]) -> Option<(String, Option<String>)> {
    let before: usize =
        text.split_inclusive(|byte| *byte == b'\n').take(error.line().checked_sub(1)?).map(<[u8]>::len).sum();
    let is_of_word = |byte: &u8| byte.is_ascii_alphanumeric() || b"+-".contains(byte);
    let at = (before + error.column()).min(text.len());
    let start = text[..at].iter().rposition(|byte| !is_of_word(byte)).map_or(0, |last| last + 1);
    let end = at + text[at..].iter().position(|byte| !is_of_word(byte)).unwrap_or(text.len() - at);
    let word = str::from_utf8(&text[start..end]).ok()?;
    let name = word.trim_start_matches(['+', '-']).to_lowercase();
    let known = ["nan", "inf", "infinity"].contains(&name.as_str());
    known.then(|| (word.to_string(), last_key(&String::from_utf8_lossy(&text[..start])).map(String::from)))
}

/// The last key in a text of JSON.
fn last_key(mut text: &str) -> Option<&str> {
    while let Some(colon) = text.rfind(':') {
        text = &text[..colon];
        if let Some(name) = text.trim_end().strip_suffix('"') {
            return Some(&name[name.rfind('"')? + 1..]);
        }
    }
    None
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

/// A file and its values, by key; a key that is missing is `null`.
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

/// A value for an error message; short values are shown whole.
pub(crate) fn found(value: &Value) -> String {
    match value {
        Value::Null => "nothing".into(),
        Value::Object(_) => kind(value).into(),
        Value::Array(list) if list.len() > 8 => format!("a list of {}", list.len()),
        _ => value.to_string().chars().take(100).collect(),
    }
}
