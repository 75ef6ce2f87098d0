use super::{Cameras, Settings, Strategy, defaults};
use weaver_run::settings::{Error, Layers, parse, resolve, to_toml};

fn with(sets: &[&str]) -> Result<Settings, Error> {
    resolve(&defaults(), None, &sets.iter().map(|s| s.to_string()).collect::<Vec<_>>())
}

/// Settings win over the file and the file over the defaults.
#[test]
fn settings_win_over_files_over_defaults() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("settings.toml");
    let text = "rate = 2\nseed = 5\nlimit = 7\ncameras = \"found\"\n[[stages]]\nsteps = 1\n[[stages]]\n[[stages]]\nname = \"last\"\n";
    std::fs::write(&path, text).unwrap();
    let s =
        resolve(&defaults(), Some(&path), &["seed=9".into(), "limit=7.5".into(), "stages.2.steps=3".into()]).unwrap();
    assert_eq!((s.rate, s.seed, s.limit, s.cameras), (2.0, 9, Some(7.5), Cameras::Found));
    let stages: Vec<_> = s.stages.iter().map(|stage| (stage.name.as_str(), stage.steps)).collect();
    assert_eq!(stages, [("coarse", 1), ("fine", 20), ("last", 3)]);
    assert_eq!((s.folder, s.background), (defaults().folder, defaults().background));
}

#[test]
fn values_are_toml_or_a_bare_word() {
    let s = with(&["folder=C:/some where", "background=[0, 0.5, 1]", " rate = 3 ", "cameras=\"found\""]).unwrap();
    assert_eq!((s.folder.to_str().unwrap(), s.background, s.rate), ("C:/some where", [0.0, 0.5, 1.0], 3.0));
    assert_eq!(s.cameras, Cameras::Found);
    assert_eq!(with(&["limit=1", "limit=none"]).unwrap(), defaults());
}

#[test]
fn another_kind_keeps_what_both_have() {
    let s = with(&["strategy.every=7", "strategy.kind=relocate", "strategy.cap=90"]).unwrap();
    assert_eq!(s.strategy, Strategy::Relocate { every: 7, cap: 90 });
    let s = with(&["strategy.kind=relocate"]).unwrap();
    assert_eq!(s.strategy, Strategy::Relocate { every: 100, cap: 0 });
    // In a file, a table with another kind starts afresh.
    let mut layers = Layers::new(&defaults()).unwrap();
    layers.merge("strategy = { kind = 'relocate', every = 3 }".parse().unwrap(), "text").unwrap();
    assert_eq!(layers.finish("text").unwrap().strategy, Strategy::Relocate { every: 3, cap: 0 });
}

#[test]
fn errors_name_place_key_and_what_was_found() {
    for (setting, message) in [
        ("seed", "seed: expected key=value"),
        ("sed=1", "sed=1: unknown key `sed`; did you mean `seed`?"),
        ("zzz=1", "zzz=1: unknown key `zzz`"),
        ("stages.1.stpes=1", "stages.1.stpes=1: unknown key `stages.1.stpes`; did you mean `steps`?"),
        ("stages.2.steps=1", "stages.2.steps=1: stages: expected an index below 2, found `2`"),
        ("rate.x=1", "rate.x=1: rate has no part `x`"),
        ("rate=fast", "rate=fast: rate: expected float, found string `\"fast\"`"),
        ("strategy.cap=none", "strategy.cap=none: unknown field `cap`, expected `every` or `threshold` in `strategy`"),
        ("seed=-1", "seed=-1: invalid value: integer `-1`, expected u64 in `seed`"),
        ("background=[1, 2]", "background=[1, 2]: invalid length 2, expected an array of length 3 in `background`"),
        (
            "strategy.kind=splt",
            "strategy.kind=splt: unknown variant `splt`, expected `split` or `relocate` in `strategy.kind`",
        ),
    ] {
        assert_eq!(with(&[setting]).unwrap_err().to_string(), message);
    }
}

#[test]
fn errors_of_files_name_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("settings.toml");
    let message =
        || resolve(&defaults(), Some(&path), &[]).unwrap_err().to_string().replace(path.to_str().unwrap(), "F");
    assert!(message().starts_with("F: "), "{}", message());
    for (text, parts) in [
        ("rate = ", vec!["F: ", "line 1"]),
        ("stages = 5", vec!["F: stages: expected array, found integer `5`"]),
        ("[[stages]]\nstep = 5", vec!["F: unknown key `stages.0.step`; did you mean `steps`?"]),
        ("seed = 1.5", vec!["F: seed: expected integer, found float `1.5`"]),
        ("seed = -5", vec!["F: ", "`-5`", "`seed`"]),
    ] {
        std::fs::write(&path, text).unwrap();
        assert!(parts.iter().all(|part| message().contains(part)), "{}", message());
    }
    std::fs::write(&path, b"\xff").unwrap();
    assert!(message().contains("UTF-8"), "{}", message());
}

#[test]
fn text_reads_back() {
    let s = with(&["limit=0.1", "folder=a\\b \"c\"\nd", "strategy.kind=relocate"]).unwrap();
    assert_eq!(parse::<Settings>(&to_toml(&s).unwrap(), "text").unwrap(), s);
    let message = parse::<Settings>("seed = 1", "text").unwrap_err().to_string();
    assert!(message.starts_with("text: missing field `rate`"), "{message}");
}

#[test]
fn what_toml_cannot_hold_is_an_error() {
    let s = Settings { seed: u64::MAX, ..defaults() };
    let message = resolve(&s, None, &[]).unwrap_err().to_string();
    assert!(message.starts_with("defaults: ") && message.contains("u64"), "{message}");
}

/// Keys given by a layer are distinguished from defaults, also where the values are equal.
#[test]
fn given_keys_are_known() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("settings.toml");
    std::fs::write(&file, format!("seed = {}\n[strategy]\nevery = 5\n", defaults().seed)).unwrap();
    let layers = Layers::of(&defaults(), Some(&file), &["limit=2".into()]).unwrap();
    for key in ["seed", "strategy.every", "limit"] {
        assert!(layers.gives(key), "{key}");
    }
    for key in ["rate", "strategy", "strategy.threshold"] {
        assert!(!layers.gives(key), "{key}");
    }
}
