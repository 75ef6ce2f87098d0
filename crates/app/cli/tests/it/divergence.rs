//! Losses that are no longer numbers.

use crate::in_process::{line, splatweaver};
use crate::run::Run;

#[test]
fn a_run_that_explodes_stops_and_keeps_its_checkpoint() {
    let run = Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let rate = "stages.0.rate=1e30";
    let steps = "30";
    line(&[&"train --preset micro --steps", &steps, &"--set", &rate, &"--data", &run.data(), &"--out", &out])
        .refused(1, &["step 2: pose is NaN", "training stopped", "last good checkpoint", "checkpoint.safetensors"]);
    let checkpoint = out.join("checkpoint.safetensors");
    let told = splatweaver(&[&"info", &checkpoint]).fine();
    assert!(told.stdout.contains("step: 0"), "{}", told.stdout);
    splatweaver(&[&"eval", &"--run", &out]).fine();
}

#[test]
fn an_absurd_weight_is_named_with_its_step() {
    let run = Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let weight = "stages.0.losses.pose.l1=1e39";
    line(&[&"train --preset micro --steps 5 --set", &weight, &"--data", &run.data(), &"--out", &out])
        .refused(1, &["step 1: loss is inf", "training stopped"]);
    assert!(out.join("checkpoint.safetensors").is_file());
}
