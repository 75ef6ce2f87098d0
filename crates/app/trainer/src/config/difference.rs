//! Equality of two configurations as far as bits are concerned.

use super::Config;
use crate::Recipe;
use std::collections::BTreeMap;
use weaver_run::settings::{Table, Value};

/// Keys that change no weight of a run that has begun: the number of threads, the files to write, the use of the
/// result, and the first weights.
const WITHOUT_EFFECT: [&str; 4] = ["threads", "output", "evaluation", "init"];

impl<R: Recipe> Config<R> {
    /// The first key that determines the weights and differs from an `earlier` configuration, with both values; `None`
    /// where a run under either goes on in the same way.
    ///
    /// Where captures, their teacher and the weights of LPIPS are does not count: a resumed run compares the content.
    /// The last stage may be longer here: that is how a run is prolonged.
    pub fn difference(&self, earlier: &Self) -> Option<(String, String, String)> {
        let (own, mut before) = (keys_of(self), keys_of(earlier));
        let last = self.stages.len().saturating_sub(1);
        if let (Some(stage), Some(shorter)) = (self.stages.get(last), earlier.stages.get(last))
            && stage.steps > shorter.steps
        {
            before.insert(format!("stages.{last}.steps"), stage.steps.to_string());
        }
        let key = own.keys().chain(before.keys()).find(|key| own.get(*key) != before.get(*key))?;
        let value = |keys: &BTreeMap<String, String>| keys.get(key).cloned().unwrap_or_else(|| "nothing".into());
        Some((key.clone(), value(&own), value(&before)))
    }
}

/// Every key that determines the weights, as a dotted path, with its value.
fn keys_of<R: Recipe>(config: &Config<R>) -> BTreeMap<String, String> {
    let mut table: Table = config.to_toml().parse().expect("a configuration is TOML");
    WITHOUT_EFFECT.iter().for_each(|key| _ = table.remove(*key));
    let mut keys = BTreeMap::new();
    flatten(&Value::Table(table), "", &mut keys);
    keys
}

fn flatten(value: &Value, path: &str, keys: &mut BTreeMap<String, String>) {
    let inner = |key: &str| if path.is_empty() { key.to_string() } else { format!("{path}.{key}") };
    match value {
        Value::Table(table) => table.iter().for_each(|(key, value)| flatten(value, &inner(key), keys)),
        Value::Array(list) => {
            list.iter().enumerate().for_each(|(i, value)| flatten(value, &inner(&i.to_string()), keys));
        }
        Value::String(_)
            if path.starts_with("data.folders") || path == "data.teacher" || path.ends_with("_weights") =>
        {
            // Its content counts.
        }
        value => _ = keys.insert(path.into(), value.to_string()),
    }
}
