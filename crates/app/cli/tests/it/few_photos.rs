//! Too few photos.

use crate::capture;
use crate::in_process::splatweaver;
use crate::run::Run;
use std::path::Path;

fn few(views: usize, word: &str) {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("capture");
    capture::transforms(&data, views);
    let out = folder.path().join("run");
    let scale = "data.scene_scale=3";
    splatweaver(&[&"train", &"--preset", &"micro", &"--set", &scale, &"--data", &data, &"--out", &out])
        .refused(1, &["capture", word, "at least"]);
    assert!(!out.exists());
    splatweaver(&[&"eval", &"--run", &Run::shared().path(), &"--data", &data])
        .refused(1, &["capture", word, "at least"]);
}

#[test]
fn none() {
    few(0, "photos");
    let run = Run::shared().path();
    let (folder, results) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let out = results.path().join("out");
    splatweaver(&[&"infer", &"--run", &run, &"-o", &out]).refused(2, &["required"]);
    splatweaver(&[&"infer", &"--run", &run, &folder.path(), &"-o", &out]).refused(1, &["photos", "found none"]);
    assert!(!out.exists());
}

#[test]
fn one_cannot_be_trained_or_evaluated_on() {
    few(1, "views");
}

#[test]
fn one_can_be_looked_at_with_a_warning() {
    let run = Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let photo = run.data().join("images/01.png");
    let done = splatweaver(&[&"infer", &"--run", &run.path(), &photo, &"-o", &folder.path()]).fine();
    assert!(done.stderr.contains("warning: one photo"), "{}", done.stderr);
    assert!(folder.path().join("scene.ply").is_file());
}

#[test]
fn what_is_no_photo_is_named() {
    let run = Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let (photo, out) = (folder.path().join("a.png"), folder.path().join("out"));
    let infer = |photo: &Path| splatweaver(&[&"infer", &"--run", &run.path(), &photo, &"-o", &out]);
    infer(&photo).refused(1, &["a.png"]);
    std::fs::write(&photo, "no picture").unwrap();
    infer(&photo).refused(1, &["a.png", "JPEG, PNG, TIFF or WebP"]);
    assert!(!out.exists());
}
