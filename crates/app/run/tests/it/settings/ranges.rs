use super::{Settings, defaults};
use weaver_run::settings::{Layers, check, parse, resolve, to_toml};

fn message(setting: &str) -> String {
    resolve(&defaults(), None, &[setting.into()]).unwrap_err().to_string()
}

/// Numbers out of their range are refused with key range and value.
///
/// Promise of `every_number_has_a_named_range`.
#[test]
fn numbers_out_of_range_are_refused() {
    for (setting, message_) in [
        ("rate=0", "rate=0: rate: expected more than 0, found 0"),
        ("rate=nan", "rate=nan: rate: expected more than 0, found NaN"),
        ("rate=inf", "rate=inf: rate: expected more than 0, found inf"),
        ("background=[0, 1.5, 0]", "background=[0, 1.5, 0]: background.1: expected 0 to 1, found 1.5"),
        ("limit=-1", "limit=-1: limit: expected at least 0, found -1"),
        ("strategy.threshold=1", "strategy.threshold=1: strategy.threshold: expected 0 to less than 1, found 1"),
        ("stages.1.steps=0", "stages.1.steps=0: stages.1.steps: expected 1 to 1000, found 0"),
        ("stages.1.steps=1001", "stages.1.steps=1001: stages.1.steps: expected 1 to 1000, found 1001"),
    ] {
        assert_eq!(message(setting), message_);
    }
    let edges = ["background=[0, 1, 0]", "limit=0", "strategy.threshold=0", "stages.0.steps=1", "stages.1.steps=1000"];
    for setting in edges {
        assert!(resolve(&defaults(), None, &[setting.into()]).is_ok(), "{setting}");
    }
}

/// The range of a key belongs to the current variant.
#[test]
fn another_variant_has_other_ranges() {
    let mut layers = Layers::new(&defaults()).unwrap();
    layers.merge("strategy = { kind = 'relocate', every = 3, cap = 7 }".parse().unwrap(), "text").unwrap();
    assert!(layers.finish("text").is_ok());
}

/// Ranges hold for files and for settings made in code.
#[test]
fn ranges_hold_in_files_and_in_code() {
    let text = to_toml(&defaults()).unwrap().replace("rate = 0.5", "rate = -0.5");
    assert_eq!(parse::<Settings>(&text, "F").unwrap_err().to_string(), "F: rate: expected more than 0, found -0.5");
    let wrong = Settings { limit: Some(f64::NAN), ..defaults() };
    assert_eq!(check(&wrong, "code").unwrap_err().to_string(), "code: limit: expected at least 0, found NaN");
    assert!(check(&defaults(), "code").is_ok());
    assert!(check(&Settings { seed: u64::MAX, ..defaults() }, "code").is_err());
}

#[test]
fn errors_name_the_file_and_the_settings_over_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("settings.toml");
    std::fs::write(&path, "seed = 1").unwrap();
    let text = resolve(&defaults(), Some(&path), &["limit=-1".into()]).unwrap_err().to_string();
    assert_eq!(text, format!("{}, limit=-1: limit: expected at least 0, found -1", path.display()));
}
