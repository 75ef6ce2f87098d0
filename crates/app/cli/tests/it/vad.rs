//! Detectors of anomalies are trained, stopped, judged and used; mismatched inputs are refused by name.

use crate::command::{BINARY, printed, refused, text};
use crate::in_process::with_slashes;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use weaver_io::{Background, Image, write_npy};

const TRAIN: &str = "vad train --encoder convolutions --steps 30 --threads 1";

/// The numbers that a command prints as JSON.
fn json(folder: &Path, line: &str) -> serde_json::Value {
    serde_json::from_str(&printed(folder, line)).unwrap()
}

#[test]
fn planted_anomalies_are_learned_and_judged() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let out = printed(folder, &format!("{TRAIN} --out run"));
    assert!(out.contains("AUC") && with_slashes(&out).contains("report: run/report.html"), "{out}");
    let log = fs::read_to_string(folder.join("run/metrics.jsonl")).unwrap();
    // 30 steps, 20 on labels, 15 of each of four experts, 10 of the gate.
    assert_eq!(log.lines().count(), 30 + 20 + 4 * 15 + 10);
    assert!(!folder.join("run/checkpoint.safetensors").exists());
    let report = fs::read_to_string(folder.join("run/report.html")).unwrap();
    assert_eq!(report.matches("<img").count(), 10, "ten videos");
    assert!(report.contains("loss, gate"), "a curve for each stage");
    let metrics = json(folder, "vad eval --run run --json");
    let auc = metrics["auc"].as_f64().unwrap();
    assert!(auc > 0.5 && auc <= 1.0, "{metrics}");
    let error = refused(folder, &format!("{TRAIN} --out run"), 2);
    assert!(error.contains("run: a run exists there already"), "{error}");
    let error = refused(folder, "vad train --resume run", 2);
    assert!(error.contains("run: the run is complete"), "{error}");
    let error = refused(folder, "vad train --resume run --steps 5", 2);
    assert!(error.contains("cannot be used with"), "{error}");
    let error = refused(folder, "vad train --resume nowhere", 1);
    assert!(error.contains("nowhere/run.json") && !folder.join("nowhere").exists(), "{error}");
}

/// The scores of a video, its curve and picture; scores that are judged again.
#[test]
fn videos_are_scored() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    printed(folder, &format!("{TRAIN} --no-experts --splat none --out run"));
    let snippets = 20;
    let numbers: Vec<f32> = (0..snippets * 32).map(|i| ((i * 37) % 101) as f32 / 50.0 - 1.0).collect();
    for name in ["Abuse001_x264", "Normal_Videos_002_x264"] {
        write_npy(folder.join(format!("{name}.npy")), &[snippets, 32], &numbers).unwrap();
    }
    let annotation = "Abuse001_x264.mp4 320 Abuse 32 95 -1 -1\nNormal_Videos_002_x264.mp4 320 Normal -1 -1 -1 -1\n";
    fs::write(folder.join("annotation.txt"), annotation).unwrap();
    let files = "Abuse001_x264.npy Normal_Videos_002_x264.npy";
    printed(folder, &format!("vad score --run run {files} --annotation annotation.txt -o curves"));
    let table = fs::read_to_string(folder.join("curves/Abuse001_x264.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + snippets);
    let picture = Image::read(folder.join("curves/Abuse001_x264.png"), Background::Black).unwrap();
    assert!(picture.width > 200);
    let metrics = json(folder, "vad metrics --scores curves --annotation annotation.txt --json");
    assert!(metrics["auc"].as_f64().is_some_and(|auc| (0.0..=1.0).contains(&auc)), "{metrics}");

    write_npy(folder.join("narrow.npy"), &[4, 8], &[0.0; 32]).unwrap();
    let error = refused(folder, "vad score --run run narrow.npy -o curves", 1);
    assert!(error.contains("narrow.npy: expected 32 features") && error.contains("found 8"), "{error}");
    let mut spoiled = numbers;
    spoiled[40] = f32::NAN;
    write_npy(folder.join("nan.npy"), &[snippets, 32], &spoiled).unwrap();
    let error = refused(folder, "vad score --run run nan.npy -o curves", 1);
    assert!(error.contains("nan.npy") && error.to_lowercase().contains("nan"), "{error}");
}

/// Ctrl-C keeps the learned weights, and the run goes on to the bits of an uninterrupted one.
///
/// Promise of `a_stopped_training_goes_on_to_the_same_bits`.
/// Promise of `a_stop_says_what_it_waits_for`.
#[cfg(unix)]
#[test]
fn a_training_that_is_interrupted_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    printed(folder, &format!("{TRAIN} --out whole"));
    let line = format!("{TRAIN} --out parts");
    // After that many, the second stage is under way.
    let done = interrupted(folder, &line, "parts", 35);
    let said = text(&done.stderr);
    assert!(done.status.success() && said.contains("to go on: splatweaver vad train --resume parts"), "{said}");
    assert!(said.contains("stopping after this step; again to stop at once"), "{said}");
    let error = refused(folder, &line, 2);
    assert!(error.contains("go on with it by --resume"), "{error}");
    printed(folder, "vad train --resume parts --threads 2");
    let model = |run: &str| fs::read(folder.join(run).join("model.safetensors")).unwrap();
    assert!(model("parts") == model("whole"));
    assert_eq!(losses(&folder.join("parts/metrics.jsonl")), losses(&folder.join("whole/metrics.jsonl")));
}

/// The losses of a log, by steps.
#[cfg(unix)]
fn losses(log: &Path) -> Vec<(usize, Option<f64>)> {
    weaver_run::read_records(log).unwrap().iter().map(|record| (record.step, record.value("loss"))).collect()
}

/// Starts a training, and presses Ctrl-C after `after` steps.
#[cfg(unix)]
fn interrupted(folder: &Path, line: &str, run: &str, after: usize) -> std::process::Output {
    let mut child = Command::new(BINARY)
        .current_dir(folder)
        .args(line.split_whitespace())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let log = folder.join(run).join("metrics.jsonl");
    let steps = || fs::read_to_string(&log).map_or(0, |text| text.lines().count());
    let before = steps();
    while steps() < before + after {
        assert!(child.try_wait().unwrap().is_none(), "ended early");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let id = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    child.wait_with_output().unwrap()
}

/// Promise of `a_capture_that_changed_is_not_gone_on_with`.
#[cfg(unix)]
#[test]
fn a_training_on_other_features_does_not_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::create_dir(folder.join("features")).unwrap();
    let mut list = String::new();
    for i in 0..8 {
        let values: Vec<f32> = (0..40 * 16).map(|at| ((at * (i + 3)) % 17) as f32 / 17.0).collect();
        let kind = if i < 4 { "Abuse" } else { "Normal_Videos" };
        let name = format!("{kind}{i:03}_x264.npy");
        write_npy(folder.join("features").join(&name), &[40, 16], &values).unwrap();
        list += &format!("{name}\n");
    }
    fs::write(folder.join("list.txt"), list).unwrap();
    let line = "vad train --features features --list list.txt --encoder deepmil --no-experts --steps 1000000 --out run";
    let done = interrupted(folder, line, "run", 1);
    assert!(done.status.success(), "{}", text(&done.stderr));
    // The same number of videos, with the same names and lengths.
    let [a, b] = ["Abuse000_x264.npy", "Abuse001_x264.npy"].map(|name| folder.join("features").join(name));
    let first = fs::read(&a).unwrap();
    fs::copy(&b, &a).unwrap();
    let error = refused(folder, "vad train --resume run", 1);
    assert!(error.contains("expected those that the run began with, found others"), "{error}");
    fs::write(&a, first).unwrap();
    let resumed = interrupted(folder, "vad train --resume run", "run", 1);
    assert!(resumed.status.success(), "{}", text(&resumed.stderr));
}
