//! The range of every number, as the derived JSON schema has it.

use super::schema::{join, property, variant};
use serde_json::Value as Schema;
use std::fmt;
use toml::Value;

/// The bounds of a number.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Range {
    least: Option<f64>,
    above: Option<f64>,
    most: Option<f64>,
    below: Option<f64>,
}

impl Range {
    /// The range declared for a key; the lower bound 0 of unsigned whole numbers follows from their type and does not
    /// count.
    pub(crate) fn stated(schema: &Schema) -> Option<Self> {
        let range = Self::of(if schema["items"].is_object() { &schema["items"] } else { schema });
        let Self { least, above, most, below } = range;
        (least.is_some_and(|least| least != 0.0)
            || above.or(most).or(below).is_some()
            || least.is_some() && !whole(schema))
        .then_some(range)
    }

    fn of(schema: &Schema) -> Self {
        let bound = |key: &str| schema[key].as_f64();
        Self {
            least: bound("minimum"),
            above: bound("exclusiveMinimum"),
            most: bound("maximum"),
            below: bound("exclusiveMaximum"),
        }
    }

    fn holds(self, value: f64) -> bool {
        value.is_finite()
            && self.least.is_none_or(|least| value >= least)
            && self.above.is_none_or(|above| value > above)
            && self.most.is_none_or(|most| value <= most)
            && self.below.is_none_or(|below| value < below)
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.least, self.above, self.most, self.below) {
            (Some(least), None, Some(most), None) => write!(f, "{least} to {most}"),
            (Some(least), None, None, Some(below)) => write!(f, "{least} to less than {below}"),
            (Some(least), None, None, None) => write!(f, "at least {least}"),
            (_, Some(above), Some(most), None) => write!(f, "more than {above} and at most {most}"),
            (_, Some(above), None, Some(below)) => write!(f, "more than {above} and less than {below}"),
            (_, Some(above), None, None) => write!(f, "more than {above}"),
            (None, None, Some(most), _) => write!(f, "at most {most}"),
            (None, None, None, Some(below)) => write!(f, "less than {below}"),
            _ => f.write_str("a finite number"),
        }
    }
}

fn whole(schema: &Schema) -> bool {
    let schema = if schema["items"].is_object() { &schema["items"] } else { schema };
    let integer = |kind: &Schema| kind == "integer";
    integer(&schema["type"]) || schema["type"].as_array().is_some_and(|kinds| kinds.iter().any(integer))
}

/// Checks that every number is finite and in its range; the message names the first that is not. `path` is where `tree`
/// is.
pub(crate) fn check(tree: &Value, schema: &Schema, path: &str) -> Result<(), String> {
    let number = |value: f64| {
        let range = Range::of(schema);
        if range.holds(value) { Ok(()) } else { Err(format!("{path}: expected {range}, found {value}")) }
    };
    match tree {
        Value::Integer(value) => number(*value as f64),
        Value::Float(value) => number(*value),
        Value::Array(entries) => entries
            .iter()
            .enumerate()
            .try_for_each(|(i, entry)| check(entry, &schema["items"], &join(path, &i.to_string()))),
        Value::Table(table) => {
            let kind = table.get("kind").and_then(Value::as_str);
            let schema = kind.map_or(schema, |kind| variant(schema, kind));
            table.iter().try_for_each(|(key, value)| {
                check(value, property(schema, key).unwrap_or(&Schema::Null), &join(path, key))
            })
        }
        _ => Ok(()),
    }
}
