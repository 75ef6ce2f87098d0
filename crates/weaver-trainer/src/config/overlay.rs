//! Laying one TOML tree over another: every key must be known, and a wrong one gets the nearest name.

use crate::Error;
use serde::de::DeserializeOwned;
use std::path::Path;
use toml::{Table, Value};

pub(super) fn read_file(path: &Path) -> Result<Table, Error> {
    weaver_io::read_text(path)?.parse().map_err(|e: toml::de::Error| error(&path.display().to_string(), e.to_string()))
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

/// Lays `over` on `base`: tables key by key, lists of tables entry by entry, everything else as a whole.
pub(super) fn merge(base: &mut Value, over: Value, source: &str) -> Result<(), Error> {
    merge_at(base, over, source, "")
}

fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.into() } else { format!("{path}.{key}") }
}

fn merge_at(base: &mut Value, over: Value, source: &str, path: &str) -> Result<(), Error> {
    match (base, over) {
        (Value::Table(base), Value::Table(over)) => {
            for (key, value) in over {
                let known = base.get_mut(&key).is_some();
                if !known {
                    return Err(unknown(base, &key, source, path));
                }
                let slot = base.get_mut(&key).expect("just found");
                merge_at(slot, value, source, &join(path, &key))?;
            }
            Ok(())
        }
        (Value::Array(base), Value::Array(over)) if base.first().is_some_and(Value::is_table) => {
            // A list of stages in a file: each entry starts from the preset's entry of its place, or from the last one.
            let template = base.clone();
            base.clear();
            for (i, entry) in over.into_iter().enumerate() {
                let mut slot = template[i.min(template.len() - 1)].clone();
                merge_at(&mut slot, entry, source, &join(path, &i.to_string()))?;
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

fn unknown(table: &Table, key: &str, source: &str, path: &str) -> Error {
    let hint =
        nearest(key, table.keys().map(String::as_str)).map_or(String::new(), |n| format!("; did you mean `{n}`?"));
    error(source, format!("unknown key `{}`{hint}", join(path, key)))
}

/// Applies one `key=value`: the key is a dotted path (list entries by number), the value TOML or a bare word.
pub(super) fn set(tree: &mut Value, setting: &str) -> Result<(), Error> {
    let source = format!("--set {setting}");
    let (key, text) = setting.split_once('=').ok_or_else(|| error(&source, "expected key=value"))?;
    let (key, text) = (key.trim(), text.trim());
    let value = format!("value = {text}")
        .parse::<Table>()
        .ok()
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| Value::String(text.into()));
    let mut slot = tree;
    let mut path = String::new();
    for part in key.split('.') {
        slot = match slot {
            Value::Table(table) => {
                if !table.contains_key(part) {
                    return Err(unknown(table, part, &source, &path));
                }
                table.get_mut(part).expect("just found")
            }
            Value::Array(list) => {
                let count = list.len();
                part.parse::<usize>()
                    .ok()
                    .and_then(|i| list.get_mut(i))
                    .ok_or_else(|| error(&source, format!("{path}: expected an index below {count}, found `{part}`")))?
            }
            _ => return Err(error(&source, format!("{path} has no part `{part}`"))),
        };
        path = join(&path, part);
    }
    merge_at(slot, value, &source, &path)
}

pub(super) fn deserialize<D: DeserializeOwned>(tree: Value, source: &str) -> Result<D, Error> {
    // The error names the key on a line of its own; a message is one line.
    tree.try_into().map_err(|e: toml::de::Error| error(source, e.to_string().trim().replace('\n', " ")))
}

#[cfg(test)]
mod tests {
    use super::super::Config;

    fn message(settings: &[&str]) -> String {
        let settings: Vec<String> = settings.iter().map(|s| (*s).to_string()).collect();
        Config::resolve(Some("micro"), None, &settings).unwrap_err().to_string()
    }

    #[test]
    fn settings_reach_their_place() {
        let settings =
            ["stages.1.rate=1", "model.width=64", "stages.1.allocation=sampled", "data.folders=[\"a\", \"b\"]"];
        let config = Config::resolve(Some("micro"), None, &settings.map(String::from)).unwrap();
        assert_eq!(
            (config.stages[1].rate, config.model.width, config.stages[1].allocation.as_str()),
            (1.0, 64, "sampled")
        );
        assert_eq!(config.data.folders.len(), 2);
    }

    #[test]
    fn wrong_settings_are_explained() {
        assert!(message(&["model.widht=64"]).contains("unknown key `model.widht`; did you mean `width`?"));
        assert!(message(&["model.width=wide"]).contains("model.width: expected integer, found string"));
        assert!(
            message(&["model.width=-8"]).contains("`-8`, expected usize in `model.width`"),
            "{}",
            message(&["model.width=-8"])
        );
        assert!(message(&["stages.7.rate=1"]).contains("expected an index below 2, found `7`"));
        assert!(message(&["seed"]).contains("expected key=value"));
    }

    #[test]
    fn files_lie_between_preset_and_flags() {
        let folder = std::env::temp_dir().join(format!("weaver-config-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("c.toml");
        std::fs::write(&path, "preset = \"micro\"\nseed = 3\n[model]\nwidth = 64\n[[stages]]\nsteps = 5\n").unwrap();
        let config = Config::resolve(None, Some(&path), &["seed=4".into()]).unwrap();
        assert_eq!((config.preset.as_str(), config.seed, config.model.width), ("micro", 4, 64));
        assert_eq!((config.stages.len(), config.stages[0].steps), (1, 5));
        std::fs::write(&path, "[model]\nbackbone = 3\n").unwrap();
        let text = Config::resolve(None, Some(&path), &[]).unwrap_err().to_string();
        assert!(text.contains("c.toml") && text.contains("model.backbone: expected table"), "{text}");
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn endless_scenes_have_no_frame_of_their_own() {
        let config = Config::resolve(Some("micro"), None, &["data.endless=5".into()]).unwrap();
        assert!(config.stages.iter().all(|s| s.losses.pose_absolute == 0.0 && s.losses.pose > 0.0));
    }

    #[test]
    fn a_resolved_config_survives_its_file() {
        let config = Config::preset("tiny").unwrap();
        assert_eq!(Config::from_toml(&config.to_toml(), "x").unwrap(), config);
    }

    #[test]
    fn steps_rescale_in_proportion() {
        let mut config = Config::preset("tiny").unwrap();
        let ratio = config.stages[0].steps as f64 / config.steps() as f64;
        config.rescale(100);
        assert_eq!(config.steps(), 100);
        assert!((config.stages[0].steps as f64 - 100.0 * ratio).abs() <= 1.0);
    }
}
