//! Estimates of a dry run, beside the cost of the run itself; and the trace of a run.

use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// Standard output and standard error of a command that succeeds.
fn splatweaver(folder: &Path, arguments: &[&str]) -> [String; 2] {
    let output = Command::new(env!("CARGO_BIN_EXE_splatweaver")).current_dir(folder).args(arguments).output().unwrap();
    let texts = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    assert!(output.status.success(), "{}", texts[1]);
    texts
}

/// The number before `MB` in the first line that holds both it and `what`.
fn megabytes(text: &str, what: &str) -> f64 {
    let line = text
        .lines()
        .find(|line| line.contains(what) && line.contains(" MB"))
        .unwrap_or_else(|| panic!("no `{what}` in {text}"));
    let (before, _) = line.split_once(" MB").unwrap();
    before.rsplit(' ').next().unwrap().parse().unwrap()
}

const TRAIN: [&str; 5] = ["train", "--preset", "micro", "--threads", "2"];

#[test]
fn the_plan_is_what_is_then_measured() {
    let folder = tempfile::tempdir().unwrap();
    // A run of a few steps must draw the largest ones that the plan is for.
    let train = [&TRAIN[..], &["--set", "stages.1.model.dense=1"]].concat();
    let [plan, _] = splatweaver(folder.path(), &[&train[..], &["--dry-run"]].concat());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "a dry run leaves nothing behind");
    let parameters = megabytes(&plan, "parameters");
    assert!(parameters > 0.5 && (megabytes(&plan, "optimizer") / parameters - 2.0).abs() < 0.2, "{plan}");
    assert_eq!(plan.matches("activations").count(), 2, "a plan for each stage: {plan}");
    assert!(
        plan.contains(" x linear") && megabytes(&plan, "with gradients") > megabytes(&plan, "activations"),
        "{plan}"
    );
    if cfg!(target_os = "linux") {
        let run = [&train[..], &["--steps", "16", "--out", "run"]].concat();
        let [_, notes] = splatweaver(folder.path(), &run);
        let (planned, measured) = (megabytes(&plan, "peak"), megabytes(&notes, "at most"));
        assert!((planned / measured - 1.0).abs() < 0.1, "planned {planned} MB, measured {measured} MB");
    }
}

/// A dry run makes no folder for temporary files that stays, where `TMPDIR` names one that is not there.
///
/// Promise (files): a dry run leaves no folder behind, not even one for temporary files.
#[test]
fn a_dry_run_leaves_no_folder_behind() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_splatweaver"));
    command.current_dir(folder.path()).args(TRAIN).args(["--steps", "1", "--dry-run"]);
    let output = command.env("TMPDIR", folder.path().join("not/there")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_trace_holds_a_step_of_each_stage() {
    let folder = tempfile::tempdir().unwrap();
    crate::command::capture(folder.path());
    let few = ["--steps", "10", "--out", "run", "--data", "capture", "--set", "data.scene_scale=1"];
    splatweaver(folder.path(), &[&TRAIN[..], &few, &["--trace", "step.json"]].concat());
    let text = std::fs::read_to_string(folder.path().join("step.json")).unwrap();
    let trace: Value = serde_json::from_str(&text).unwrap();
    let events = trace["traceEvents"].as_array().unwrap();
    for stage in 0..2 {
        let spans = || events.iter().filter(|e| e["ph"] == "X" && e["pid"] == stage);
        let ends = |e: &Value| e["ts"].as_f64().unwrap() + e["dur"].as_f64().unwrap();
        let part = |name: &str| spans().find(|e| e["tid"] == 0 && e["name"] == name).unwrap();
        for (category, part) in [("forward", part("forward")), ("backward", part("backward"))] {
            let ops: Vec<&Value> = spans().filter(|e| e["cat"] == category).collect();
            assert!(ops.len() > 100, "{category}: {} ops", ops.len());
            let layer =
                |e: &&&Value| e["name"] == "linear" && e["args"]["path"].as_str().unwrap().ends_with(".attn.qkv");
            assert!(ops.iter().any(|e| layer(&e)), "no linear layer called qkv {category}");
            // Within the part of the step, up to the clock's own time.
            let within =
                |e: &&Value| e["ts"].as_f64() >= part["ts"].as_f64().map(|t| t - 50.0) && ends(e) <= ends(part) + 50.0;
            assert!(ops.iter().all(within), "an op outside of its part of the step");
        }
        part("tuples");
        part("optimizer");
    }
    assert!(events.iter().any(|e| e["ph"] == "M" && e["args"]["name"] == "a step of stage poses"));
}
