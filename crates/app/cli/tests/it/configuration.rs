//! Configurations that make no sense.

use crate::in_process::splatweaver;

#[track_caller]
fn refused(arguments: &[&str], parts: &[&str]) {
    refused_with(1, arguments, parts);
}

#[track_caller]
fn refused_with(code: u8, arguments: &[&str], parts: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let mut line: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&"train", &"--out", &out];
    line.extend(arguments.iter().map(|a| a as &dyn AsRef<std::ffi::OsStr>));
    splatweaver(&line).refused(code, parts);
    assert!(!out.exists());
}

#[test]
fn models_are_found_by_name() {
    let registry = weaver_cli::models();
    let names: Vec<&str> = registry.iter().map(|entry| entry.name()).collect();
    assert_eq!(names, ["splatweaver", "photo", "two-experts", "wild"]);
    for entry in registry.iter() {
        for preset in entry.presets() {
            assert!(entry.annotated(preset).unwrap().contains("architecture"), "{preset}");
        }
    }
}

#[test]
fn unknown_preset() {
    refused(&["--preset", "tinny"], &["preset", "tinny", "did you mean `tiny`"]);
}

#[test]
fn unknown_keys() {
    refused(&["--set", "model.widht=64"], &["model.widht", "did you mean `width`"]);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mine.toml");
    std::fs::write(&file, "[data]\npool = 8\nfodlers = []\n").unwrap();
    refused(&["--config", file.to_str().unwrap()], &["mine.toml", "fodlers"]);
}

#[test]
fn impossible_sizes() {
    for setting in ["model.width=-8", "model.backbone.dim=0", "data.context_views=-1", "stages.0.rate=-1"] {
        let (key, _) = setting.split_once('=').unwrap();
        refused(&["--preset", "micro", "--set", setting], &[key.rsplit('.').next().unwrap()]);
    }
}

/// A network that does not fit into memory is refused before it is made: an allocation that fails ends the process.
#[test]
fn networks_larger_than_memory_are_refused() {
    for width in ["65536", "999936"] {
        let size = format!("model.backbone.dim={width}");
        refused_with(
            75,
            &["--preset", "micro", "--set", &size],
            &["GB of memory", "smaller sizes in the section `model`"],
        );
    }
}

#[test]
fn text_that_is_no_toml() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mine.toml");
    std::fs::write(&file, "[data\npool = 8\n").unwrap();
    refused(&["--config", file.to_str().unwrap()], &["mine.toml", "line 1"]);
    refused(&["--config", "/nonexistent.toml"], &["/nonexistent.toml"]);
}

/// The output of `config` is a configuration: every key documented, and equal to the preset that it was printed from.
#[test]
fn a_printed_configuration_is_read_back() {
    let printed = splatweaver(&[&"config", &"--preset", &"micro"]).fine().stdout;
    let keys = printed.lines().filter(|line| !line.starts_with('#') && line.contains(" = ")).count();
    let lines: Vec<&str> = printed.lines().collect();
    let is_key = |line: &str| !line.starts_with('#') && line.contains(" = ");
    let documented = lines.windows(2).filter(|pair| pair[0].starts_with("# ") && is_key(pair[1])).count();
    // The kind of a parametrization is documented with its table.
    assert_eq!(keys, documented + 1, "{printed}");
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("mine.toml"), folder.path().join("run"));
    std::fs::write(&file, &printed).unwrap();
    splatweaver(&[&"train", &"--config", &file, &"--dry-run", &"--steps", &"2"]).fine();
    splatweaver(&[&"train", &"--config", &file, &"--set", &"data.pool=1", &"--out", &out]).refused(1, &["pool"]);
    assert!(!out.exists());
}

#[test]
fn unknown_models_and_presets_of_config() {
    splatweaver(&[&"config", &"--model", &"splatweever"]).refused(1, &["model", "splatweaver", "splatweever"]);
    splatweaver(&[&"config", &"--preset", &"huge"]).refused(1, &["preset", "tiny", "huge"]);
}
