//! Type and documentation of every key, from the derived JSON schema.

use super::Settings;
use serde_json::Value as Schema;
use std::any::TypeId;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// The schema of settings, with no references in it: derived once for each type, since this takes longer than all uses
/// of it.
pub(crate) fn schema<S: Settings>() -> &'static Schema {
    static DERIVED: Mutex<BTreeMap<TypeId, &'static Schema>> = Mutex::new(BTreeMap::new());
    let mut derived = DERIVED.lock().unwrap_or_else(PoisonError::into_inner);
    derived.entry(TypeId::of::<S>()).or_insert_with(|| {
        let settings = schemars::generate::SchemaSettings::default().with(|s| s.inline_subschemas = true);
        Box::leak(Box::new(settings.into_generator().into_root_schema_for::<S>().to_value()))
    })
}

/// The keys of a table with their schemas, of all its variants if it has several.
pub(crate) fn properties(schema: &Schema) -> Vec<(&str, &Schema)> {
    let own = schema["properties"].as_object().into_iter().flatten().map(|(key, value)| (key.as_str(), value));
    let variants = ["oneOf", "anyOf"].into_iter().filter_map(|k| schema[k].as_array()).flatten();
    own.chain(variants.flat_map(properties)).collect()
}

pub(crate) fn property<'s>(schema: &'s Schema, key: &str) -> Option<&'s Schema> {
    let variants = || ["oneOf", "anyOf"].into_iter().filter_map(|k| schema[k].as_array()).flatten();
    schema["properties"].get(key).or_else(|| variants().find_map(|variant| property(variant, key)))
}

/// True if a key may be left out.
pub(crate) fn is_optional(schema: &Schema) -> bool {
    let null = |s: &Schema| s["type"] == "null";
    schema["type"].as_array().is_some_and(|types| types.iter().any(|t| t == "null"))
        || schema["anyOf"].as_array().is_some_and(|any| any.iter().any(null))
}

/// True if a value may have a fraction.
pub(crate) fn is_number(schema: &Schema) -> bool {
    schema["type"] == "number" || schema["type"].as_array().is_some_and(|types| types.iter().any(|t| t == "number"))
}

/// The variant of this kind, where a table has several.
pub(crate) fn variant<'s>(table: &'s Schema, kind: &str) -> &'s Schema {
    let mut variants = table["oneOf"].as_array().into_iter().flatten();
    variants.find(|schema| schema["properties"]["kind"]["const"] == kind).unwrap_or(table)
}

/// The path of a key in the table at `path`.
pub(crate) fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.into() } else { format!("{path}.{key}") }
}
