//! Answers and progress for a program that drives this one.

use crate::command::{capture, splatweaver, text};
use serde_json::Value;
use std::path::Path;

/// The answer of a command, and the lines of its progress.
fn driven(folder: &Path, line: &str) -> (Value, Vec<Value>) {
    let run = splatweaver(folder, &format!("{line} --json --progress json"));
    let told = text(&run.stderr);
    let lines = told.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"))).collect();
    assert!(run.status.success(), "{told}");
    (serde_json::from_str(&text(&run.stdout)).unwrap(), lines)
}

/// Promise (figures): a command that makes files names them and its warnings as JSON, and each line of its progress
/// is an object.
#[test]
fn programs_are_told_of_files_and_progress() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    capture(folder);
    weaver_io::write_gaussians(folder.join("scene.ply"), &crate::compare::gaussians()).unwrap();
    for (line, made) in [
        ("convert scene.ply scene.spz", &["scene.spz"][..]),
        ("image fit capture/images/00.png --gaussians 20 --steps 5 -o a.wgi", &["a.wgi"]),
        ("image draw a.wgi -o a.png", &["a.png"]),
        ("vad train --steps 2 -o vad", &["vad/model.safetensors", "vad/report.html"]),
    ] {
        let (answer, lines) = driven(folder, line);
        assert_eq!(answer["outputs"], serde_json::json!(made), "{line}");
        let warnings: Vec<&Value> = lines.iter().filter_map(|line| line.get("warning")).collect();
        assert_eq!(answer["warnings"], serde_json::json!(warnings), "{line}");
        assert!(made.iter().all(|file| folder.join(file).is_file()), "{line}");
    }
    let (answer, lines) = driven(folder, "fit capture --steps 30 --gaussians 200 -o fit");
    assert_eq!(answer["steps"], 30);
    let last = lines.iter().rfind(|line| line["progress"] == "fit").unwrap();
    assert_eq!((&last["done"], &last["total"]), (&30.into(), &30.into()));
    let failed = splatweaver(folder, "fit nothing -o no --progress json");
    let last: Value = serde_json::from_str(text(&failed.stderr).lines().last().unwrap()).unwrap();
    assert!(!failed.status.success() && last["error"].as_str().unwrap().starts_with("nothing: "), "{last}");
}
