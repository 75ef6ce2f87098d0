//! Checkpoints that do not fit their run.

use crate::capture::{edit, halve};
use crate::in_process::splatweaver;
use crate::run::Run;
use std::path::Path;
use weaver_io::safetensors::Tensors;

/// Evaluating, inferring and resuming all refuse a run with this checkpoint and leave it as it is.
#[track_caller]
fn refused(spoil: impl FnOnce(&Path), parts: &[&str]) {
    let run = Run::shared();
    let folder = run.copy();
    let checkpoint = folder.path().join("checkpoint.safetensors");
    spoil(&checkpoint);
    let before = std::fs::read(&checkpoint).unwrap();
    let (photo, out) = (run.data().join("images/01.png"), folder.path().join("out"));
    splatweaver(&[&"eval", &"--run", &folder.path()]).refused(1, parts);
    splatweaver(&[&"infer", &"--run", &folder.path(), &photo, &"-o", &out]).refused(1, parts);
    splatweaver(&[&"train", &"--resume", &folder.path()]).refused(1, parts);
    assert_eq!(std::fs::read(&checkpoint).unwrap(), before);
    assert!(!out.exists());
}

#[test]
fn wrong_shape() {
    let spoil = |path: &Path| {
        let mut tensors = Tensors::read(path).unwrap();
        let name = tensors.tensors.keys().find(|k| k.starts_with("param.")).unwrap().clone();
        let values = tensors.tensors[&name].data.len();
        tensors.insert(name, &[values, 1, 1], vec![0.0f32; values]);
        tensors.write(path).unwrap();
    };
    refused(spoil, &["checkpoint.safetensors", "tensor param.", "1, 1]"]);
}

#[test]
fn missing_tensor() {
    let spoil = |path: &Path| {
        let mut tensors = Tensors::read(path).unwrap();
        let name = tensors.tensors.keys().find(|k| k.starts_with("ema.")).unwrap().clone();
        tensors.tensors.remove(&name);
        tensors.write(path).unwrap();
    };
    refused(spoil, &["checkpoint.safetensors", "tensor ema."]);
}

#[test]
fn cut_short() {
    refused(halve, &["checkpoint.safetensors", "complete safetensors file"]);
}

#[test]
fn of_another_preset() {
    let folder = Run::shared().copy();
    edit(&folder.path().join("config.toml"), |t| t.replace("preset = \"micro\"", "preset = \"tiny\""));
    splatweaver(&[&"eval", &"--run", &folder.path()])
        .refused(1, &["checkpoint.safetensors", "preset", "`tiny`", "`micro`"]);
}

#[test]
fn of_another_size() {
    let folder = Run::shared().copy();
    edit(&folder.path().join("config.toml"), |t| t.replace("sh_degree = 0", "sh_degree = 1"));
    splatweaver(&[&"eval", &"--run", &folder.path()])
        .refused(1, &["checkpoint.safetensors", "metadata model", "expected"]);
}

#[test]
fn no_run_folder() {
    let folder = tempfile::tempdir().unwrap();
    let nowhere = folder.path().join("nowhere");
    for command in [&["eval", "--run"][..], &["train", "--resume"]] {
        splatweaver(&[&command[0], &command[1], &nowhere]).refused(1, &["nowhere"]);
    }
    assert!(!nowhere.exists());
}
