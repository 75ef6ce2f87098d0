//! Configurations that make no sense.

use crate::command::splatweaver;

#[track_caller]
fn refused(arguments: &[&str], parts: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let mut line: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&"train", &"--out", &out];
    line.extend(arguments.iter().map(|a| a as &dyn AsRef<std::ffi::OsStr>));
    splatweaver(&line).refused(1, parts);
    assert!(!out.exists());
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

#[test]
fn text_that_is_no_toml() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mine.toml");
    std::fs::write(&file, "[data\npool = 8\n").unwrap();
    refused(&["--config", file.to_str().unwrap()], &["mine.toml", "line 1"]);
    refused(&["--config", "/nonexistent.toml"], &["/nonexistent.toml"]);
}
