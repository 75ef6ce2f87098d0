//! Training on photos without cameras; a teacher with random weights predicts them.

use crate::in_process::splatweaver;
use crate::published::{Scene, checkpoint};
use crate::run::Run;
use std::path::{Path, PathBuf};
use weaver_io::safetensors::Tensors;
use weaver_io::{Background, Image};

/// Photos and nothing else.
fn photos(folder: &Path) -> PathBuf {
    let capture = folder.join("photos");
    std::fs::create_dir_all(&capture).unwrap();
    for photo in weaver_io::list_photos(Run::shared().data().join("images")).unwrap() {
        std::fs::copy(&photo, capture.join(photo.file_name().unwrap())).unwrap();
    }
    capture
}

fn train(data: &Path, teacher: &Path, out: &Path) -> crate::in_process::Outcome {
    let line: [&dyn AsRef<std::ffi::OsStr>; 11] =
        [&"train", &"--preset", &"micro", &"--steps", &"2", &"--data", &data, &"--teacher", &teacher, &"--out", &out];
    splatweaver(&line)
}

fn checksum(run: &Path) -> String {
    let text = std::fs::read_to_string(run.join("summary.json")).unwrap();
    serde_json::from_str::<serde_json::Value>(&text).unwrap()["checksum"].as_str().unwrap().into()
}

/// Photos without cameras are trained on with a teacher whose predictions are kept.
///
/// Promise (options): `--teacher` trains on photos without cameras; the teacher's answers are kept.
#[test]
fn a_teacher_replaces_cameras() {
    let (scene, folder) = (Scene::shared(), tempfile::tempdir().unwrap());
    let (capture, weights) = (photos(folder.path()), folder.path().join("teacher-weights.safetensors"));
    std::fs::copy(scene.weights(), &weights).unwrap();
    let cache = capture.join("teacher.safetensors");
    let out = |name: &str| folder.path().join(name);
    let done = train(&capture, &weights, &out("first")).fine();
    assert!(done.stderr.contains("cameras and depth of 10 photos are the teacher's"), "{}", done.stderr);
    let first = Tensors::read(&cache).unwrap();
    assert_eq!(first.metadata["format"], "splatweaver-teacher-1");
    assert_eq!(first.get("viewmats").unwrap().shape, [10, 3, 4]);
    // The teacher sees photos at its own size, in whole patches of the network's shape.
    assert_eq!(first.get("depth").unwrap().shape, [10, 32, 32]);

    // The kept file is used: marked depth changes the trained weights, and stays.
    let second = train(&capture, &weights, &out("second")).fine();
    assert_eq!((checksum(&out("second")), second.stdout.contains("PSNR")), (checksum(&out("first")), true));
    let mut marked = first.clone();
    let depth: Vec<f32> = first.values::<f32>("depth", &[10, 32, 32]).unwrap().iter().map(|d| 1.5 * d).collect();
    marked.insert("depth", &[10, 32, 32], depth.clone());
    marked.write(&cache).unwrap();
    train(&capture, &weights, &out("marked")).fine();
    assert_ne!(checksum(&out("marked")), checksum(&out("first")));
    assert_eq!(Tensors::read(&cache).unwrap().values::<f32>("depth", &[10, 32, 32]).unwrap(), depth);

    // A run that is resumed or evaluated finds its photos in the same way.
    let run = out("marked");
    splatweaver(&[&"train", &"--resume", &run, &"--steps", &"3"]).fine();
    splatweaver(&[&"eval", &"--run", &run]).fine();

    // Other photos, and other weights, are taught anew.
    let entry = |key: &str| Tensors::read(&cache).unwrap().metadata[key].clone();
    let (teacher, seen) = (entry("teacher"), entry("photos"));
    let photo = capture.join("03.png");
    let mut image = Image::read(&photo, Background::White).unwrap();
    image.pixels[..60].fill(0.0);
    image.write_png(&photo).unwrap();
    train(&capture, &weights, &out("third")).fine();
    assert!(entry("photos") != seen && entry("teacher") == teacher);
    assert_ne!(Tensors::read(&cache).unwrap().values::<f32>("depth", &[10, 32, 32]).unwrap(), depth);
    let mut other = checkpoint("encoder.");
    other.insert(
        "encoder.camera_head.token_norm.bias",
        &other.get("encoder.camera_head.token_norm.bias").unwrap().shape.clone(),
        vec![0.3_f32; 64],
    );
    other.write(&weights).unwrap();
    train(&capture, &weights, &out("fourth")).fine();
    assert_ne!(entry("teacher"), teacher);
    splatweaver(&[&"train", &"--resume", &run, &"--steps", &"4"])
        .refused(1, &["data.folders.0: expected the photos, cameras and points", "photos"]);

    // With masks, too.
    let masks = capture.join("masks");
    std::fs::create_dir_all(&masks).unwrap();
    for i in 0..10 {
        let mut mask = Image::filled(40, 32, [1.0; 3]);
        mask.pixels[..600].fill(0.0);
        mask.write_png(masks.join(format!("{i:02}.png"))).unwrap();
    }
    let line: [&dyn AsRef<std::ffi::OsStr>; 13] = [
        &"train",
        &"--preset",
        &"micro",
        &"--steps",
        &"2",
        &"--data",
        &capture,
        &"--teacher",
        &weights,
        &"--set",
        &"data.masks=true",
        &"--out",
        &out("masked"),
    ];
    splatweaver(&line).fine();
}

#[test]
fn what_is_wrong_with_a_teacher_is_said_with_its_file() {
    let (scene, folder) = (Scene::shared(), tempfile::tempdir().unwrap());
    let capture = photos(folder.path());
    let out = folder.path().join("run");
    let refused = |data: &Path, teacher: &Path, parts: &[&str]| {
        train(data, teacher, &out).refused(1, parts);
        assert!(!out.exists(), "nothing is left behind");
    };
    let missing = folder.path().join("none.safetensors");
    refused(&capture, &missing, &["none.safetensors"]);
    let run = Run::shared().path().join("checkpoint.safetensors");
    refused(&capture, &run, &["checkpoint.safetensors", "expected the tensors of SplatWeaver or VGGT", "training run"]);
    let empty = folder.path().join("empty");
    std::fs::create_dir_all(&empty).unwrap();
    refused(&empty, &scene.weights(), &["empty: photos: expected at least one"]);
    // A file of that name that is something else is not overwritten.
    let own = capture.join("teacher.safetensors");
    let mut tensors = Tensors::default();
    tensors.insert("x", &[1], vec![1.0_f32]);
    tensors.write(&own).unwrap();
    let before = std::fs::read(&own).unwrap();
    refused(&capture, &scene.weights(), &["teacher.safetensors: expected what a teacher said", "move it away"]);
    assert_eq!(std::fs::read(&own).unwrap(), before);
    // Without a teacher, such photos are refused as ever.
    splatweaver(&[&"train", &"--preset", &"micro", &"--data", &capture, &"--out", &out])
        .refused(1, &["cameras: expected transforms.json", "--teacher"]);
}
